"""The atlas: one panel over many limits of the control, and a map of its outcomes.

Knows panels as they are specified and run; reads summaries, never their evidence.
"""
