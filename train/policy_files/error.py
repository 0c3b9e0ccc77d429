"""What is wrong with a policy's files."""


class PolicyFileError(ValueError):
    """A policy file, or a statistics file, that cannot be read safely; one sentence says why."""
