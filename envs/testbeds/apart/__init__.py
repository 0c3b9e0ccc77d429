"""Tasks of libraries that run in a Python environment of their own, behind a process."""
