"""The store: Parquet files of records, each one batch, with what reads and prints them.

Knows files and queries, not how records came about.
"""
