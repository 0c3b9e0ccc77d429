"""Numbers as they are stated: equal to every digit written."""

from __future__ import annotations

from decimal import Decimal

import pytest


def stated(text: str):
    """Whatever rounds to the number written.

    >>> 0.0741 == stated("0.07"), 0.0741 == stated("0.075")
    (True, False)
    """
    digit = Decimal(text).as_tuple().exponent
    return pytest.approx(float(text), rel=0, abs=0.5 * 10.0**digit)
