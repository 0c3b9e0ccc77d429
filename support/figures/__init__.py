"""What all figures share: colours, markers, and how a figure is begun and written.

Knows pictures of numbers, not where the numbers come from.
"""
