"""A run held against its own plan: files, policies, records, and what is reported of them.

Knows what is planned, what ran and what it came to; a room above running and results.
"""
