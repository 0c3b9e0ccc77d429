"""What a finished block leaves: outcomes by policy and cell, and what pins where they come from.

Knows the evidence that they are made of, and which of them may be combined.
"""
