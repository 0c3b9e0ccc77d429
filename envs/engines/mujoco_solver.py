"""MuJoCo's solver settings, read from a model and written into one.

What they mean: https://mujoco.readthedocs.io/en/stable/XMLreference.html#option.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, ClassVar, Final

from integ_gym.support.errors import InputError
from integ_gym.support.parameters import unknown_name

from .stepping import check_number, check_settings

_NUMBERS: Final = {
    "iterations": int, "ls_iterations": int, "noslip_iterations": int,
    "tolerance": float, "ls_tolerance": float, "noslip_tolerance": float, "impratio": float,
}  # fmt: skip
"""Settings that are numbers, 0 or above."""

_CHOICES: Final = {
    "solver": ("PGS", "CG", "Newton"),
    "cone": ("pyramidal", "elliptic"),
    "jacobian": ("dense", "sparse", "auto"),
}
"""Settings with names for values, as model files have them, in the order of MuJoCo's numbers."""

_FLAGS: Final = {
    "eulerdamp": "mjDSBL_EULERDAMP",
    "refsafe": "mjDSBL_REFSAFE",
    "warmstart": "mjDSBL_WARMSTART",
}
"""Settings that are on or off. `eulerdamp`: Euler takes joint damping implicitly. `refsafe`: a
contact's time constant is at least twice the timestep, so that the contact law changes with it."""

SETTINGS: Final = (*_NUMBERS, *_CHOICES, *_FLAGS)
"""Names of all settings."""


NO_RESET: Final = "mjDSBL_AUTORESET"
"""The flag that keeps MuJoCo from resetting a motion that diverges; it has had it since 3.2."""


def was_reset(mujoco: Any, data: Any) -> bool:
    """Whether MuJoCo has reset a motion that diverged, which before 3.2 it always does.

    A reset sets the counts of warnings to 0, but for that of the divergence. So
    `silencer`, after which no count of these kinds is 0, must have acted before the motion.
    """
    if hasattr(mujoco.mjtDisableBit, NO_RESET):
        return False
    kinds = mujoco.mjtWarning
    bad = kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC
    return not all(data.warning[int(kind)].number for kind in bad)


class MujocoSettings:
    """What engines of MuJoCo's family do with settings of the solver: they go into its model.

    Attributes:
        settings: those that were given; after the model is built, all of its own.
    """

    name: ClassVar[str]
    integrator: str
    settings: Mapping[str, Any]
    maps: ClassVar[Mapping[str, str]]

    @classmethod
    def settable(cls, integrator: str) -> tuple[str, ...]:
        """Names of the settings that an integrator takes."""
        return SETTINGS

    @classmethod
    def solves(cls, integrator: str) -> bool:
        """Whether there are settings of its solver."""
        return bool(cls.settable(integrator))

    def read_solver(self, given: Mapping[str, Any]) -> None:
        """Keep what was given, for the model.

        Raises:
            ValueError: for a setting that it does not take, or an impossible value.
        """
        check_settings(self.name, given, self.settable(self.integrator))
        self.settings = {name: check_setting(name, value) for name, value in given.items()}

    def settings_of(self, mujoco: Any, model: Any) -> dict[str, Any]:
        """Those of a model's settings that it takes."""
        own = self.settable(self.integrator)
        return {name: x for name, x in read_solver(mujoco, model).items() if name in own}

    @property
    def map(self) -> str:
        """Name of the one-step map: `Euler` takes damping explicitly without `eulerdamp`."""
        explicit = self.integrator.lower().endswith("euler") and not self.settings.get(
            "eulerdamp", True
        )
        return "symplectic_euler" if explicit else self.maps[self.integrator]


@contextmanager
def translate_refusal(simulator: str) -> Iterator[None]:
    """Have a simulator take a model of MuJoCo's.

    Raises:
        ValueError: for a setting of the solver that it does not implement.
    """
    try:
        yield
    except NotImplementedError as error:
        raise InputError(f"{simulator} does not take this `solver`: {error}") from None


def read_solver(mujoco: Any, model: Any) -> dict[str, Any]:
    """All settings of a model, as plain data."""
    option = model.opt
    numbers = {name: kind(getattr(option, name)) for name, kind in _NUMBERS.items()}
    choices = {name: values[getattr(option, name)] for name, values in _CHOICES.items()}
    flags = {
        name: not option.disableflags & int(getattr(mujoco.mjtDisableBit, bit))
        for name, bit in _FLAGS.items()
    }
    return {**numbers, **choices, **flags}


def write_solver(mujoco: Any, model: Any, settings: Mapping[str, Any]) -> None:
    """Change settings of a model.

    Args:
        mujoco: the module.
        model: changed.
        settings: those that change, as :func:`read_solver` gives them.

    Raises:
        ValueError: for an unknown setting or an impossible value, with what is possible.
    """
    option = model.opt
    for name, given in settings.items():
        value = check_setting(name, given)
        if name in _NUMBERS:
            setattr(option, name, value)
        elif name in _CHOICES:
            setattr(option, name, _CHOICES[name].index(value))
        else:
            bit = int(getattr(mujoco.mjtDisableBit, _FLAGS[name]))
            option.disableflags = option.disableflags & ~bit if value else option.disableflags | bit


def check_setting(name: str, value: Any) -> Any:
    """A setting's value, numbers as MuJoCo has them.

    Raises:
        ValueError: for an unknown setting or an impossible value, with what is possible.
    """
    if name in _NUMBERS:
        return check_number(name, value, _NUMBERS[name], may_be_zero=True)
    if name in _CHOICES:
        values = _CHOICES[name]
        if value not in values:
            raise InputError(unknown_name(f"`solver.{name}`", str(value), values))
    elif name in _FLAGS:
        if not isinstance(value, bool):
            raise InputError(f"`solver.{name}` must be true or false, got {value!r}")
    else:
        raise InputError(unknown_name("setting of MuJoCo's `solver`", name, SETTINGS))
    return value
