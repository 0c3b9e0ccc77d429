"""A panel on an engine of others, or by any number of processes on one directory or object store.

What is done is what a run on one machine does, unit by unit: each is named by a small value, done
beside the run, and put in place once it is decided that it counts.
"""
