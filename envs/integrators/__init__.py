"""Integrators: one-step maps of any plant, one module each, found by name.

An integrator knows what a system gives it and no plant by name.
"""
