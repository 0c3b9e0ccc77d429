"""Lines of a diagnosis: what was measured, what is expected, and whether it holds."""
