"""Discretizations that a film is asked to show, by name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, TypeAlias

import gymnasium as gym

from integ_gym.envs.catalogue.lookup import environment_setup, is_integ_environment
from integ_gym.envs.registries import ENVIRONMENTS
from integ_gym.envs.settings import DISCRETIZATION, Discretization, check_divides
from integ_gym.envs.testbeds.making import testbed_of

from ..panel.specification.cells.cell import Cell

Asked: TypeAlias = Discretization | Mapping[str, Any] | str
"""A discretization; some of its parts; or its name, as panels write it."""

TRUE_NAMES = ("truth", "reference")


def chosen(asked: Asked, like: Discretization, env_id: str) -> Discretization:
    """The discretization that is asked for.

    Args:
        asked: such as ``"explicit_euler"``, ``"explicit_euler dt=0.0125"``, ``"mujoco RK4"`` or
            ``"truth"``.
        like: has the step, the control period and the engine of what does not say its own.
        env_id: one of integ-gym's environments.

    Raises:
        ValueError: for what is no name of a discretization, and for a step that does not divide
            the control period.
    """
    if isinstance(asked, Discretization):
        return asked
    parts = _parts(asked) if isinstance(asked, str) else dict(asked)
    unknown = sorted(set(parts) - set(DISCRETIZATION))
    if unknown or "integrator" not in parts:
        raise ValueError(
            f"a discretization is an integrator, and if need be its engine before it and dt=S "
            f"after it, such as 'explicit_euler dt=0.0125'; got {asked!r}"
        )
    if parts["integrator"] in TRUE_NAMES:
        truth = testbed_of(env_id, {}).truth(parts.get("control_period", like.control_period))
        assert truth is not None  # of our environments
        return truth
    made = replace(like, **parts)
    if made.dt > 0.0:
        check_divides("dt", made.dt, "the control period", made.control_period)
    return made


def _parts(name: str) -> dict[str, Any]:
    """Parts of a discretization's name."""
    *words, last = name.split() or [""]
    dt: dict[str, Any] = {}
    if last.startswith("dt="):
        try:
            dt = {"dt": float(last.removeprefix("dt="))}
        except ValueError:
            raise ValueError(f"dt must be a number of seconds, got {last!r} in {name!r}") from None
    else:
        words.append(last)
    if not all(words) or len(words) not in (1, 2):
        return {}
    engine = {"engine": words[0]} if len(words) == 2 else {}
    return {**engine, "integrator": words[-1], **dt}


def arguments_on(cell: Discretization, arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Constructor arguments of an environment on another discretization."""
    return Cell(cell, "grid").arguments(arguments)


def check_possible(
    cells: Iterable[Discretization], env_id: str, arguments: Mapping[str, Any]
) -> None:
    """Refuse discretizations that an environment cannot have, before any episode is played.

    Raises:
        TypeError, ValueError: with the valid choices.
        ModuleNotFoundError: if an engine is missing, with the command that installs it.
    """
    for cell in cells:
        environment_setup(env_id, arguments_on(cell, arguments))


def check_filmed(env_id: str) -> None:
    """Refuse an environment that there are no pictures of.

    Raises:
        ValueError: for any but integ-gym's own.
    """
    if is_integ_environment(env_id):
        return
    remedy = f"of a record of {env_id} `integ-gym evidence show` prints the numbers"
    if env_id in gym.registry:
        remedy = f'{env_id} has pictures of its own, see render_mode="rgb_array" of gymnasium.make'
    raise ValueError(f"films show {', '.join(ENVIRONMENTS)}; {remedy}")
