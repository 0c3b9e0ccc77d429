"""The bench: who is examined, and how motions are followed on it, each leaving evidence."""
