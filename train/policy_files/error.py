"""What is wrong with a policy's files, and what to do about one that is refused."""

RETRAIN = "train with PPO('MlpPolicy', ...) and save again"
DAMAGED = "save it again with model.save(path)"


class PolicyFileError(ValueError):
    """A policy file, or a statistics file, that cannot be read safely; one sentence says why."""
