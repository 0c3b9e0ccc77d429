"""How much of a stranger's file is read."""

MAX_WEIGHTS_BYTES = 256 * 2**20
"""Largest `policy.pth` that is read, in bytes, also after unpacking (256 MiB)."""
MAX_JSON_BYTES = 16 * 2**20
"""Largest `data` member and largest statistics file that are read, in bytes (16 MiB)."""
