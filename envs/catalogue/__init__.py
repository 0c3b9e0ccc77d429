"""The registered ids: their environments, with the contract of each in its docstring.

Knows which task goes with which defaults; adding an id is adding a file.
"""
