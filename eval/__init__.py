"""Evaluation: panels, statistics, verdicts and reports."""
