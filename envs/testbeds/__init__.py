"""Testbeds: tasks that can be made in any discretization, ours and other libraries'.

What `train`, `panel` and `evaluate` know of a task. A testbed names its hand-made controller and
never imports it.
"""
