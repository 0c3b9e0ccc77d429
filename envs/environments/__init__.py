"""Gymnasium environments around an episode: single, vector, functional, rediscretized,
and any other whose discretization is stated.

Knows how an episode is offered to whoever learns or evaluates; the ids are the catalogue's.
"""
