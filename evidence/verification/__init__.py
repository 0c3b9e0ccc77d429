"""What records say, held against their traces, the same episodes played again, and the seal.

Knows episodes and environments; plans and policies are of higher floors.
"""
