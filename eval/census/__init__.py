"""A census: which one-step map each pendulum and cart-pole of a name really is.

Knows published environments and engines from outside, by their states.
"""
