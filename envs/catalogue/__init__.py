"""The registered ids: an environment in each file, with its contract."""
