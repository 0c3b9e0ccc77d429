"""How large a policy file may be, and what is wrong with one, in one sentence."""

from __future__ import annotations

from integ_gym.support.errors import IntegGymError

RETRAIN = "train with PPO('MlpPolicy', ...) and save again"


DAMAGED = "save it again with model.save(path)"


class PolicyFileError(IntegGymError, ValueError):
    """A policy file, or a statistics file, that cannot be read safely; one sentence says why."""


MAX_WEIGHTS_BYTES = 256 * 2**20
"""Largest `policy.pth` that is read, in bytes, also after unpacking (256 MiB)."""


MAX_JSON_BYTES = 16 * 2**20
"""Largest `data` member and largest statistics file that are read, in bytes (16 MiB)."""
