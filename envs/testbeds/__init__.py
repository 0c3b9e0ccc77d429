"""Testbeds: tasks that can be made in any discretization, ours and other libraries'."""
