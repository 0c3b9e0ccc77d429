"""The registered ids: an environment and its task in each file, with the contract in its docstring."""
