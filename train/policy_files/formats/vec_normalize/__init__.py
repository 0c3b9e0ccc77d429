"""`vecnormalize.pkl` of stable-baselines3, read as data: nothing that it names is ever called.

Knows the opcodes of pickles and what `VecNormalize` holds; imports nothing that a file names.
"""
