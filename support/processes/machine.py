"""What results tell of the machine that made them."""

from __future__ import annotations

import platform
from functools import cache


@cache
def host() -> str:
    """Operating system and processor, not the machine's own name or kernel."""
    return f"{platform.system()} {platform.machine()}"


def instruction_sets() -> tuple[str, ...]:
    """Processor family, then the vector extensions that numpy found and uses, in its names.

    Whether products and sums are fused decides last bits, and a policy's success after training
    may hang on these.
    """
    import numpy as np

    found = np.show_config(mode="dicts").get("SIMD Extensions", {})
    return (platform.machine(), *found.get("baseline", ()), *found.get("found", ()))
