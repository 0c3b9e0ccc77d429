"""A policy that exists already: read, with what is known of its training, and planned around.

An evaluation is a panel without training.
"""
