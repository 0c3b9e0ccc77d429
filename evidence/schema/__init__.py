"""What a record is: its fields with units, as Arrow and JSON schemas, and its content hash.

Knows what is recorded, not when or where.
"""
