"""Observation and action space, as `data` prints them."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ....policy.actions import BoxActions, DiscreteActions, spread
from ....policy.arrays import FloatArray
from ...error import PolicyFileError
from .data import Json, printed_class

_PASS_BOUNDS = "pass action_bounds=(low, high)"
_NUMBER_TEXT = re.compile(r"[-+]?(?:inf|\d+\.(?P<decimals>\d*)(?P<exponent>e[-+]\d+)?)")


def _space_kind(space: Json) -> str:
    """Class name of a Gymnasium (or Gym) space, for example `Box`."""
    text = str(space.get(":type:", "a space without a readable type"))
    parts = printed_class(text).split(".")
    return parts[-1] if parts[:2] in (["gymnasium", "spaces"], ["gym", "spaces"]) else text


def box_size(space: Json, what: str) -> int:
    """How many numbers a `Box` has, which SB3 flattens; a message calls it ``what``."""
    kind, shape = _space_kind(space), _shape(space)
    sizes = shape if isinstance(shape, list) else []
    if kind != "Box" or not sizes or not all(type(n) is int and n > 0 for n in sizes):
        raise PolicyFileError(
            f"the {what} is {kind} of shape {shape}, and only a Box"
            f"{' or Discrete' if what == 'action space' else ''} can be read; "
            "flatten the environment's space and train again"
        )
    return math.prod(sizes)


def _shape(space: Json) -> Any:
    """Of a space: files that were written under gym store ``shape``, later ones ``_shape``."""
    return space.get("_shape", space.get("shape"))


def decoding(
    space: Json,
    squash: bool,
    action_bounds: tuple[ArrayLike, ArrayLike] | None,
    limit: float = math.inf,
) -> BoxActions | DiscreteActions:
    """How outputs become actions of this space."""
    if _space_kind(space) == "Discrete":
        return _discrete_actions(space, squash, action_bounds)
    size = box_size(space, "action space")
    if space.get("dtype") != "float32":
        raise PolicyFileError(
            f"the action space has dtype {space.get('dtype')}, and only float32 can be read; "
            "train in an environment with a float32 Box"
        )
    if action_bounds is None:
        low, high = (_printed_bound(space, name, size) for name in ("low", "high"))
    else:
        low, high = (spread(bound, size) for bound in action_bounds)
    actions = BoxActions(low, high, squash, limit)
    if actions.size != size:
        raise PolicyFileError(
            f"action_bounds have length {actions.size} and the action space {size}; "
            "pass one number per action"
        )
    return actions


def _discrete_actions(
    space: Json, squash: bool, action_bounds: tuple[ArrayLike, ArrayLike] | None
) -> DiscreteActions:
    """A `Discrete` space that counts from 0."""
    n, start = str(space.get("n")), str(space.get("start", "0"))
    if not re.fullmatch(r"[1-9]\d{0,8}", n) or start != "0":
        raise PolicyFileError(
            f"the action space Discrete(n={n}, start={start}) cannot be read, because "
            "stable-baselines3 counts actions from 0; train in an environment with start=0"
        )
    if squash or action_bounds is not None:
        raise PolicyFileError(
            f"the action space Discrete({n}) has no bounds; "
            "leave out squash_output and action_bounds"
        )
    return DiscreteActions(int(n))


def _printed_bound(space: Json, name: str, size: int) -> FloatArray:
    """A bound from the text NumPy printed for it, float32 of shape (size,).

    NumPy prints eight decimals. From 0.125 up that settles a float32; below, a number of more than
    six decimals may have been rounded and is refused. (Shorter ones are what somebody typed.)
    """
    text = str(space.get(name))
    words = text.replace("[", " ").replace("]", " ").split()
    numbers = [_NUMBER_TEXT.fullmatch(word) for word in words]
    ends = len(_shape(space))
    opened, closed = len(text) - len(text.lstrip("[")), len(text) - len(text.rstrip("]"))
    whole = opened == closed == ends
    if not whole or len(numbers) != size or not all(numbers):
        raise PolicyFileError(
            f"the action space's bound '{name}' is printed as {_shortened(text)}, which does not "
            f"spell out {size} numbers; {_PASS_BOUNDS}"
        )
    for number in numbers:
        if number is not None and _may_be_rounded(number):
            raise PolicyFileError(
                f"the action space's bound '{name}' is printed as {number.group()}, which may be "
                f"rounded; {_PASS_BOUNDS}"
            )
    with np.errstate(over="ignore"):
        return np.array([float(word) for word in words]).astype(np.float32)


def _may_be_rounded(number: re.Match[str]) -> bool:
    """Whether more than one float32 is likely to be printed like this."""
    decimals = number.group("decimals") or ""
    return not number.group("exponent") and len(decimals) > 6 and abs(float(number.group())) < 0.125


def _shortened(text: str) -> str:
    """At most 60 characters of a text, on one line."""
    line = " ".join(text.split())
    return line if len(line) <= 60 else f"{line[:57]}..."
