"""Kinds and classes in words."""

from __future__ import annotations

from typing import Final

KIND_WORDS: Final = {
    "trained": "trained on",
    "given": "given policies",
    "baseline": "baselines",
}
"""Headings of a matrix's blocks of rows, in order."""

CLASS_WORDS: Final = {
    "true_pass": "true pass",
    "false_pass": "false pass",
    "false_fail": "false fail",
    "true_fail": "true fail",
}
"""The classes against the reference in words."""
