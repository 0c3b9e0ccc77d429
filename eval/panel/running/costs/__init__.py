"""What a panel is expected to take, in time and in memory, before it is begun.

Knows measured rates and the specification, not what was run.
"""
