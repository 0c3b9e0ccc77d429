"""Making a functional environment, of one discretization or of a mixture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from .environment import FunctionalEnv
from .mixture import FunctionalMixture


def make(
    env_id: str,
    *,
    dtype: str = "float32",
    mixture: Sequence[Mapping[str, Any]] | None = None,
    **arguments: Any,
) -> FunctionalEnv:
    """The functional form of an environment.

    Args:
        env_id: a registered id.
        dtype: float type of the physics, ``"float32"`` or ``"float64"``; observations are float32.
        mixture: as for ``gym.make_vec``; see
            :class:`integ_gym.envs.environments.functional.mixture.FunctionalMixture` for what is
            drawn when.
        arguments: those of ``gym.make``, but for ``render_mode``.

    Raises:
        TypeError: for an unknown argument.
        ValueError: for an impossible value, an engine outside JAX or its own stops, or float64
            outside JAX's 64-bit mode.
        ModuleNotFoundError: without JAX, with the command that installs it.
    """
    if mixture is None:
        return FunctionalEnv(env_id, dtype=dtype, **arguments)
    return FunctionalMixture(env_id, mixture, dtype=dtype, **arguments)
