"""Training with stable-baselines3 or as a compiled fleet, baselines, and policies' files.

This floor makes policies and gives them one seat to act from; judging them is not its business.
`ppo.py` is the script to read first.
"""
