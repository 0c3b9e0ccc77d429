"""What the census looks at: something that steps a pendulum or a cart-pole."""
