"""Source of functions over components, in Python or JavaScript: run once on symbols, written down.

A function written for `Ops` is called with symbols in place of floats or arrays. What it does to
them is a trace: operations and loops. The trace is written as one function without objects or
calls of our own; in Python it is compiled, and computes the same numbers to the last bit. Knows
`Ops`, not what is traced.
"""
