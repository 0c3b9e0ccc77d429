"""What ``integ-gym panel`` prints beside its page: the answer, the plan, the power, the verdicts.

Knows tables of terminals; the numbers are the panel's.
"""
