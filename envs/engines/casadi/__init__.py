"""CasADi: the plant's equations as its expressions, and its integrators as functions of floats."""
