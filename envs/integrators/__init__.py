"""Integrators: one-step maps of any plant; none knows a plant by name."""
