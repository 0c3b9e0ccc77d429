"""A census: which one-step map each pendulum and cart-pole of a name really is."""
