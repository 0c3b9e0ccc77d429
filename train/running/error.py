"""What stops a training run."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from integ_gym.envs.settings import Mixture

if TYPE_CHECKING:
    from .config import TrainingConfig


class TrainingError(RuntimeError):
    """A run that cannot go on, in one sentence with the remedy."""


@contextmanager
def explained(config: TrainingConfig, mixture: Mixture) -> Iterator[None]:
    """Learning on a mixture, of which integrators of the user's own may fail.

    Raises:
        TrainingError: if one does, or if the weights are no longer finite.
    """
    try:
        yield
    except Exception as error:
        names = dict.fromkeys(setup.settings.integrator for setup in mixture.setups)
        own = [name for name in names if ":" in name]
        if own and not isinstance(error, ValueError):
            raise TrainingError(
                f"the integrator {' or '.join(map(repr, own))} failed: {type(error).__name__}: "
                f"{error}; "
                "docs/how-to/adding.md says what an integrator must be"
            ) from error
        if not isinstance(error, ValueError):
            raise
        raise TrainingError(
            "training broke down: the policy's weights are no longer finite; lower "
            f"`learning_rate`={config.learning_rate:g}"
        ) from error
