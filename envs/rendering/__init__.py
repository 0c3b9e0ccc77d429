"""Pictures of an episode: in a window, or as arrays."""
