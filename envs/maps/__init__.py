"""One-step maps that engines apply beside our own integrators: one module each, found by name.

They are written as integrators are, and are no choice for `integrator`: an engine's name for one of
them belongs to the engine.
"""
