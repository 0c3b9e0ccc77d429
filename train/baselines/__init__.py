"""Controllers that nobody trained, for the same seat as a trained policy.

Random, zero and hand-made ones, made by name for whichever task names them.
"""
