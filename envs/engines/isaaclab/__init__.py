"""Isaac Lab: a plant as an articulation of a scene, in a process of Isaac Lab's own environment."""
