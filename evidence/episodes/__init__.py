"""Episodes on their way to records: what is said about them, their rows, labels and summaries.

Knows one episode or many at once; files are the store's.
"""
