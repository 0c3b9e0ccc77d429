"""Tasks: what is asked of a plant. A task knows no integrator, engine or environment."""
