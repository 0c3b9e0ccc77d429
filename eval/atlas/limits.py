"""The least control that a task takes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.envs import numerics
from integ_gym.envs.catalogue.lookup import environment_setup
from integ_gym.envs.settings import Discretization

from ..panel.cells import SpecError

WIDEST = 1e4
"""Largest limit of the control that is tried, as a multiple of the smallest."""


def setup_of(env_id: str, environment: Mapping[str, Any], at: Discretization) -> Any:
    """The setup of an environment in a discretization."""
    return environment_setup(env_id, {**environment, **at.arguments()})


def control_argument(setup: Any) -> tuple[str, float]:
    """Name and value of the constructor argument that limits the control.

    Raises:
        SpecError: where no single one does.
    """
    task: Any = setup.task
    limit = float(task.control_limit)
    for one in fields(task):
        value = getattr(task, one.name)
        if isinstance(value, float) and value == limit:
            doubled = replace(task, **{one.name: 2.0 * value})
            if float(doubled.control_limit) == 2.0 * limit:
                return one.name, value
    raise SpecError(f"no argument of {type(task).__name__} alone limits the control")


def middle_start(setup: Any) -> npt.NDArray[np.float64]:
    """The middle of a task's starts, in state order, shape (n,)."""
    return np.array(setup.task.draw_start(_Middle(), setup.settings.start, {}), dtype=np.float64)


def critical_limit(
    env_id: str, environment: Mapping[str, Any], argument: str, at: Discretization
) -> float:
    """Smallest limit of the control with which a search reaches the goal's energy in time.

    Args:
        env_id: one of integ-gym's environments.
        environment: constructor arguments without the discretization.
        argument: the one that limits the control; what it is set to does not matter.
        at: discretization.

    Raises:
        SpecError: if the goal's energy is not reached, or the task names no goal at rest.
    """
    rest = {name: value for name, value in environment.items() if name != argument}
    return _critical_limit(env_id, tuple(sorted(rest.items())), at)


@lru_cache(maxsize=256)
def _critical_limit(env_id: str, given: tuple[tuple[str, Any], ...], at: Discretization) -> float:
    setup = setup_of(env_id, dict(given), at)
    required = numerics.goal_energy(setup)
    if required is None:
        raise SpecError(f"{env_id} names no goal at rest; state `critical` under [atlas]")
    if required == 0.0:
        raise SpecError(
            f"{env_id}: the goal takes no energy there, so that no control is the least"
        )
    high, start = abs(required), middle_start(setup)
    try:
        return numerics.critical_limit(
            setup, start, setup.settings.duration, high / WIDEST, high, tolerance=high * 1e-5
        )
    except ValueError as error:
        raise SpecError(f"{env_id} on {at.name}: {error}") from None


class _Middle:
    """Draws the middle of every range."""

    def uniform(self, low: Any = 0.0, high: Any = 1.0, size: Any = None) -> Any:
        """(low + high) / 2, shape of ``size`` or of the ends."""
        middle = 0.5 * (np.asarray(low) + np.asarray(high))
        return middle if size is None else np.broadcast_to(middle, size)
