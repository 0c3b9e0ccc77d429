"""Published environments called pendulum or cart-pole: one module for each library."""
