"""Does a discretization's pass or fail agree with the reference?"""

from __future__ import annotations

from typing import Literal, TypeAlias

from .rules import PASS

ReferenceClass: TypeAlias = Literal["true_pass", "false_pass", "false_fail", "true_fail"]
"""A cell's pass or fail, and whether the reference agrees (true) or not (false)."""


def reference_class(s_cell: float, s_reference: float, threshold: float = PASS) -> ReferenceClass:
    """Class of a cell's answer against the reference's.

    Parameters
    ----------
    s_cell, s_reference
        Success rates of the same policies in the cell and on the reference, in [0, 1].
    threshold
        Rate from which on a policy passes.

    Returns
    -------
    `true_pass` and `true_fail` where both agree; `false_pass` where only the cell passes;
    `false_fail` where only the reference does.

    Raises
    ------
    ValueError
        If a rate or the threshold is not in [0, 1].
    """
    for name, value in (
        ("s_cell", s_cell),
        ("s_reference", s_reference),
        ("threshold", threshold),
    ):
        if not 0.0 <= value <= 1.0:
            raise ValueError(f"expected {name} in [0, 1], got {value!r}")
    if s_cell >= threshold:
        return "true_pass" if s_reference >= threshold else "false_pass"
    return "false_fail" if s_reference >= threshold else "true_fail"
