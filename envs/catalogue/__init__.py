"""The registered ids: a task and its environment in each file, with its contract."""
