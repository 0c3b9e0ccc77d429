"""Where a run's files are kept: a folder that all see, or a bucket of an object store.

Knows names and bytes, and how one of many can be sure to be the only one.
"""
