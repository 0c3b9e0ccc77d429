"""Any Gymnasium MuJoCo task under another integrator and timestep.

Knows MuJoCo's models; what is not known of a stranger's task stays unknown.
"""
