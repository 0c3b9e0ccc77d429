"""Evaluation of a policy that exists already, over the built-in discretizations."""
