"""Evaluation: panels, atlas, statistics, verdicts, reports, films; diagnosis; census; play.

The floor that judges. It knows testbeds, policies and evidence through their doors.
"""
