"""MuJoCo's solver settings, read from a model and written into one.

What they mean: https://mujoco.readthedocs.io/en/stable/XMLreference.html#option.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from integ_gym.support.errors import InputError
from integ_gym.support.parameters import unknown_name

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
    for name, value in settings.items():
        if name in _NUMBERS:
            kind = _NUMBERS[name]
            if isinstance(value, bool) or not isinstance(value, (int, float)) or value < 0:
                raise InputError(f"`solver.{name}` must be 0 or above, got {value!r}")
            if kind(value) != value:
                raise InputError(f"`solver.{name}` must be a whole number, got {value!r}")
            setattr(option, name, kind(value))
        elif name in _CHOICES:
            values = _CHOICES[name]
            if value not in values:
                raise InputError(unknown_name(f"`solver.{name}`", str(value), values))
            setattr(option, name, values.index(value))
        elif name in _FLAGS:
            if not isinstance(value, bool):
                raise InputError(f"`solver.{name}` must be true or false, got {value!r}")
            bit = int(getattr(mujoco.mjtDisableBit, _FLAGS[name]))
            option.disableflags = option.disableflags & ~bit if value else option.disableflags | bit
        else:
            raise InputError(unknown_name("setting of MuJoCo's `solver`", name, SETTINGS))
