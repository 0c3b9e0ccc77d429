"""The fleet trainer: PPO of many policies at once, compiled with JAX, on all cores or GPUs.

Knows the hyperparameters and files of the reference trainer, and the functional environments.
"""
