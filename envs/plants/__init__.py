"""Plants: continuous-time systems, a file each; none knows an integrator."""
