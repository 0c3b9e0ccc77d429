"""Files: written whole or not at all, and read within bounds.

Knows bytes and JSON, not what they say.
"""
