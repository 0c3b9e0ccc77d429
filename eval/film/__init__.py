"""Films: one policy in several discretizations, side by side, with its energy's ledger.

Knows policies and records, not what they are judged to be.
"""
