"""What stops a training run."""


class TrainingError(RuntimeError):
    """A run that cannot go on, in one sentence with the remedy."""
