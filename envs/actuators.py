"""Position servos: environments whose actions are targets of the driven coordinates."""

from __future__ import annotations

from dataclasses import fields, make_dataclass
from functools import cache
from math import pi
from typing import Any, ClassVar, cast

from integ_gym.support.errors import InputError
from integ_gym.support.parameters import nonnegative, one_of, optional, parameter, positive

from .mechanics import WHEN, Servo
from .ops.ops import Components, Ops
from .tasks.interface import Command, Limits, saturate

SERVO_ARGUMENTS = (
    "servo", "servo_stiffness", "servo_damping", "servo_period", "target_limit",
)  # fmt: skip
"""Constructor arguments of environments with servos alone."""


class _Derived:
    """Of a class that `make` makes of `base`; pickled as that, for no module holds it."""

    base: ClassVar[type[Any]]
    make: ClassVar[Any]

    def __reduce__(self) -> tuple[Any, ...]:
        values = {f.name: getattr(self, f.name) for f in fields(cast(Any, self))}
        return _remake, (self.make, self.base, values)


def _remake(make: Any, base: type[Any], values: dict[str, Any]) -> Any:
    return make(base)(**values)


class ServoPlant(_Derived):
    """What a plant has besides where its controls are targets of a :class:`Servo`."""

    controls: ClassVar[tuple[tuple[str, str], ...]]
    actuated: ClassVar[tuple[int, ...]]
    servo_stiffness: float
    servo_damping: float
    servo: str
    servo_period: float | None

    def servo_of(self, limits: Limits) -> Servo:
        """The servo with these limits of its efforts."""
        return Servo(
            self.actuated,
            self.servo_stiffness,
            self.servo_damping,
            limits,
            self.servo,
            self.servo_period,
        )


class TargetTask(_Derived):
    """What a task has besides where its actions are targets of a :class:`Servo`."""

    target_limit: float
    effort_limits: Limits

    @property
    def control_limits(self) -> Limits:
        """±`target_limit` for each."""
        limit = self.target_limit
        return ((-limit, limit),) * len(self.effort_limits)

    def command(self, ops: Ops, action: Components) -> Command:
        """The targets, saturated."""
        return saturate(ops, action, self.control_limits)


def _derive(
    make: Any, name: str, bases: tuple[type[Any], type[Any]], given: Any, **own: Any
) -> type[Any]:
    """The class that ``make`` makes of the last of the bases, with more fields and attributes."""
    base = bases[-1]
    own = {"base": base, "make": staticmethod(make), "__doc__": base.__doc__, **own}
    title = f"{name}{base.__name__}"
    return make_dataclass(title, given, bases=bases, namespace=own, frozen=True)


@cache
def with_servo(plant: type[Any]) -> type[Any]:
    """A plant class with the parameters of a servo, whose controls are its targets."""
    controls = tuple(
        (f"{plant.coordinates[k]}_target", plant.coordinate_units[k]) for k in plant.actuated
    )
    stiffness = parameter(100.0, "N m/rad, N/m", "of every servo", positive)
    damping = parameter(10.0, "N m s/rad, N s/m", "of every servo", nonnegative)
    when = parameter("continuous", "", "when servos measure", one_of(*WHEN))
    period = parameter(None, "s", "between two measurements of `period`", optional(positive))
    given = (
        ("actuator", str, parameter("position", "", "servos on the controls", one_of("position"))),
        ("servo_stiffness", float, stiffness),
        ("servo_damping", float, damping),
        ("servo", str, when),
        ("servo_period", float | None, period),
    )
    own = {"controls": controls, "input_forces": None}
    return _derive(with_servo, "Servo", (ServoPlant, plant), given, **own)


@cache
def with_efforts(plant: type[Any]) -> type[Any]:
    """A plant class that says that its controls are efforts, where targets are the default."""
    effort = parameter("effort", "", "no servos on the controls", one_of("effort"))
    return _derive(with_efforts, "Driven", (_Derived, plant), [("actuator", str, effort)])


@cache
def with_targets(task: type[Any]) -> type[Any]:
    """A task class whose actions are targets.

    Raises:
        ValueError: for a task whose actions are choices.
    """
    if task.discrete is not None:
        raise InputError(
            f"`actuator`='position' needs a `Box` of targets, and actions of {task.__name__} are "
            "choices; leave it out"
        )
    limit = parameter(pi, "rad, m", "targets are within ±`target_limit`", positive)
    given = [("target_limit", float, limit)]
    own = {"effort_limits": task.control_limits}
    return _derive(with_targets, "Target", (TargetTask, task), given, **own)
