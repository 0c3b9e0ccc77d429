"""Constructor arguments: parsed, checked and turned into a plant, a task and an engine."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from gymnasium import spaces

from integ_gym.support.parameters import (
    check_values,
    nonnegative,
    one_of,
    optional,
    parameter,
    positive,
    suggestion,
    text,
    units,
    unknown_name,
)

from ..arithmetic.ops import Component
from ..engines.interface import DIVERGENCE_SPEED, Engine
from ..engines.making import make_engine
from ..mechanics.system import PlantSystem
from ..plants.interface import Plant
from ..tasks.interface import Task
from .discretization import NATIVE
from .timing import Timing


@dataclass(frozen=True)
class Settings:
    """The arguments that all environments have in common."""

    integrator: str = parameter(
        "rk4", "", "one-step map such as `rk4`, as the engine calls it, or `module:Class`", text
    )
    dt: float = parameter(0.05, "s", "integration step", positive)
    control_period: float | None = parameter(
        None,
        "s",
        "time between two decisions, a whole multiple of `dt`; `None`: `dt`",
        optional(positive),
    )
    engine: str = parameter(
        NATIVE, "", "what advances the plant: ours, or a simulator such as `mujoco`", text
    )
    duration: float = parameter(
        10.0, "s", "truncation after ceil(duration / control_period) decisions", positive
    )
    action_latency: float = parameter(
        0.0, "s", "delay of every command, a whole multiple of `dt`", nonnegative
    )
    sensor_period: float | None = parameter(
        None,
        "s",
        "time between two samples, a whole multiple of `dt`; `None`: one per decision",
        optional(positive),
    )
    observation_noise: float = parameter(
        0.0, "SI", "standard deviation of each sensed state component", nonnegative
    )
    fallback: str = parameter(
        "hold",
        "",
        "`hold` the last control or `zero`, where no valid command acts",
        one_of("hold", "zero"),
    )
    max_speed: float | None = parameter(
        None, "rad/s, m/s", "clip on every velocity; `None`: no clip", optional(positive)
    )
    start: str = parameter("", "", "start distribution", text)
    contact: str = parameter(
        "compliant",
        "",
        "law of the stops: ours, the same in every engine, or `engine`",
        one_of("compliant", "engine"),
    )


@dataclass(frozen=True)
class Setup:
    """Everything that one discretization of an environment is made of."""

    settings: Settings
    timing: Timing
    plant: Plant
    task: Task
    system: PlantSystem
    engine: Engine

    def __getstate__(self) -> dict[str, Any]:
        """Without a simulator, which is made anew of the rest."""
        kept = self.engine if self.settings.engine == NATIVE else type(self.engine)
        return {**vars(self), "engine": kept}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        if isinstance(self.engine, type):
            made = _engine(self.engine, self.system, self.settings, self.timing)
            vars(self)["engine"] = made

    @property
    def fingerprinted(self) -> str:
        """The plant on which the engine's fingerprint is taken."""
        return self.task.plant

    @property
    def action_space(self) -> spaces.Box | spaces.Discrete:
        """`Discrete`, or a `Box` of shape (1,) in N or N m."""
        if self.task.discrete is not None:
            return spaces.Discrete(self.task.discrete)
        limit = np.max(self.task.control_limit)
        return spaces.Box(-limit, limit, shape=(1,), dtype=np.float32)

    def arguments(self) -> dict[str, Any]:
        """All constructor arguments with their values, defaults included."""
        parts = (self.settings, self.plant, self.task)
        return {f.name: getattr(part, f.name) for part in parts for f in fields(part)}  # type: ignore[arg-type]

    def units(self) -> dict[str, str]:
        """SI unit of every constructor argument."""
        return {**units(self.settings), **units(self.plant), **units(self.task)}

    def limited(self, max_episode_steps: int | None) -> Setup:
        """The same setup with episodes of at most so many decisions, which shortens `duration`.

        Raises:
            ValueError: for more than `duration` has, or less than one.
        """
        settings, horizon = self.settings, self.timing.horizon
        if max_episode_steps is None:
            return self
        whole = isinstance(max_episode_steps, (int, np.integer))
        if not (whole and 1 <= max_episode_steps <= horizon):
            raise ValueError(
                f"`max_episode_steps` must be from 1 to {horizon}, the decisions in "
                f"`duration`={settings.duration:g} s, got {max_episode_steps!r}; for longer "
                "episodes give a longer `duration`"
            )
        if max_episode_steps == horizon:
            return self
        shorter = replace(settings, duration=int(max_episode_steps) * self.timing.control_period)
        return replace(self, settings=shorter, timing=_timing(shorter))

    def with_values(
        self, plant: Plant, task: Task, timing: Timing, max_speed: Component | None
    ) -> Setup:
        """The same setup for other values, which are not looked at and may be traced.

        Args:
            plant: of the same class, as ``task``.
            timing: rates.
            max_speed: clip on every velocity, rad/s or m/s, or None.
        """
        system = _system(plant, self.settings, max_speed)
        if self.engine.batched:
            engine = self.engine.at(system, timing.dt)
        else:
            engine = _engine(type(self.engine), system, self.settings, timing)
        return replace(self, plant=plant, task=task, timing=timing, system=system, engine=engine)


def build_setup(
    plant: type[Any], task: type[Any], defaults: Mapping[str, Any], arguments: Mapping[str, Any]
) -> Setup:
    """Build the setup of an environment from its constructor arguments.

    Args:
        plant: plant class.
        task: task class.
        defaults: the environment's own defaults, by argument name.
        arguments: what the user gave; plant parameters may be arrays, one value per lane.

    Raises:
        TypeError: for an unknown argument, with the valid names.
        ValueError: for an impossible value, with the valid choices.
    """
    names = tuple(f.name for owner in (Settings, plant, task) for f in fields(owner))
    for name in arguments:
        if name == "max_episode_steps":
            raise TypeError(
                "the environment got an unexpected keyword argument 'max_episode_steps', which "
                "gym.make and gym.make_vec take; here give `duration`, s"
            )
        if name not in names:
            raise TypeError(
                f"the environment got an unexpected keyword argument {name!r}. "
                f"{suggestion(name, names)}"
            )
    values = {
        name: value.item() if isinstance(value, np.generic) or _is_scalar(value) else value
        for name, value in {**defaults, **arguments}.items()
    }
    given = _parse(Settings, values)
    settings = replace(given, start=given.start or task.starts[0])
    if settings.start not in task.starts:
        raise ValueError(unknown_name("start", settings.start, task.starts))
    timing = _timing(settings)
    the_plant = _parse(plant, values)
    if settings.max_speed is not None and settings.max_speed > DIVERGENCE_SPEED:
        raise ValueError(
            f"`max_speed`={settings.max_speed} is above {DIVERGENCE_SPEED:g}, where a motion "
            "counts as diverged; give a smaller limit or None"
        )
    if settings.contact == "engine" and getattr(the_plant, "stops", None) is None:
        raise ValueError(
            f"`contact`='engine' needs stops, and this {the_plant.name} has none; give its limit"
        )
    system = _system(the_plant, settings, settings.max_speed)
    engine = make_engine(settings.engine, system, settings.integrator, timing.dt)
    return Setup(settings, timing, the_plant, _parse(task, values), system, engine)


def _timing(settings: Settings) -> Timing:
    return Timing.of(
        settings.dt,
        settings.control_period,
        settings.action_latency,
        settings.sensor_period,
        settings.duration,
    )


def _is_scalar(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.ndim == 0


def _engine(kind: type[Any], system: PlantSystem, settings: Settings, timing: Timing) -> Engine:
    engine: Engine = kind(system, settings.integrator, timing.dt)
    return engine


def _parse(owner: type[Any], values: Mapping[str, Any]) -> Any:
    own = {f.name: values[f.name] for f in fields(owner) if f.name in values}
    for name, value in own.items():
        if owner is Settings and isinstance(value, (np.ndarray, list, tuple)):
            kind = "an array" if isinstance(value, np.ndarray) else repr(value)
            raise ValueError(
                f"`{name}` must be one value for all environments, got {kind}; parameters "
                "of the plant and the task may be arrays in gym.make_vec, and its `mixture` is a "
                "list of discretizations"
            )
        elements = value.ravel().tolist() if isinstance(value, np.ndarray) else [value]
        for element in elements:
            check_values(owner, {name: element})
    return owner(**{name: _as_float(value) for name, value in own.items()})


def _as_float(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.astype(np.float64)
    return float(value) if isinstance(value, int) and not isinstance(value, bool) else value


def _system(plant: Plant, settings: Settings, max_speed: Component | None) -> PlantSystem:
    return PlantSystem(plant, max_speed, engine_stops=settings.contact == "engine")
