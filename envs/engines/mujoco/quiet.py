"""MuJoCo without a word on motions that diverge, which its callers notice by themselves."""

from __future__ import annotations

from typing import Any

_TOLD_OF = ("INERTIA", "BADQPOS", "BADQVEL", "BADQACC")


def silencer(mujoco: Any, data: Any) -> Any:
    """A function without arguments that makes ``data`` one whose divergence is not written about.

    MuJoCo writes to standard error and to the file MUJOCO_LOG.TXT when it counts the first warning
    of a kind in ``data``; this counts one of each kind that a divergence is known by. It lasts
    until ``mj_resetData``. Other data of the process, and other warnings, are as they were.
    """
    numbers = data.warning.number
    kinds = [int(getattr(mujoco.mjtWarning, f"mjWARN_{kind}")) for kind in _TOLD_OF]

    def silence() -> None:
        numbers[kinds] += numbers[kinds] == 0

    return silence
