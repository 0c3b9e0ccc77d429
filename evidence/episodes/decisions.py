"""What was decided in an episode, told from the controls that its trace has."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.envs.catalogue.lookup import environment_setup
from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.registries import TRUTH
from integ_gym.envs.settings import NATIVE

from .record import argument_values

Array = npt.NDArray[Any]


@lru_cache(maxsize=256)
def told_setup(env_id: str, arguments: str) -> Any:
    """The setup of one of our tasks with its goal and times; no code that a record names is loaded.

    Args:
        env_id: one of integ-gym's environments.
        arguments: as a record has them.
    """
    given = {**argument_values(arguments), "engine": NATIVE, "integrator": TRUTH}
    return environment_setup(env_id, given)


def choices(task: Any, commanded: Array) -> Array:
    """Actions of a discrete set that ask for controls; NaN where none does, as in a fallback.

    Args:
        task: with ``discrete`` actions.
        commanded: controls, of any shape.
    """
    actions = np.full(commanded.shape, np.nan)
    for choice in range(task.discrete):
        actions[commanded == task.command(SCALAR, float(choice)).control] = choice
    return actions
