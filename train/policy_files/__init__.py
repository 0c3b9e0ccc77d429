"""The files of a policy: weights, side-car, and stable-baselines3's zip, read without pickle.

Knows formats and doubts every file; executes nothing that a file holds.
"""
