"""Work shared between processes and machines: an engine that runs it, or claims in one directory.

Knows tasks and units by name, and nothing of what they do.
"""
