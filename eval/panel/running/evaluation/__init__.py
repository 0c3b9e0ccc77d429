"""Evaluation of policies in cells: units of work, paired starts, replays, what can be achieved.

Knows finished policies, not how they were trained.
"""
