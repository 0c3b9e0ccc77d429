"""A step written in JAX as the census takes it."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.ops.ops import Components


def jax_step(
    advance: Callable[[Any, Any, Any], tuple[Any, Any]], gear: float = 1.0
) -> numerics.OneStep:
    """One control period by a function of (q, v, action), in float32 as JAX has it by default.

    Args:
        advance: gets arrays of shape (coordinates,), (coordinates,) and (1,); it is compiled.
        gear: the control of an action of 1, N or N m.
    """
    compiled = import_module("jax").jit(advance)

    def advanced(q: Components, v: Components, control: float) -> tuple[Components, Components]:
        end_q, end_v = compiled(*(np.array(x, dtype=np.float32) for x in (q, v, [control / gear])))
        return _numbers(end_q), _numbers(end_v)

    return advanced


def _numbers(values: Any) -> Components:
    return tuple(np.array(values, dtype=np.float64).ravel().tolist())
