"""DART: forces that no limit clamps, nothing that acts beside the mechanism, no memory."""

from __future__ import annotations

import numpy as np
import pytest
from engine_cases import needs, setup_of

ENGINE = ("dart", "semi_implicit_euler")

SWING_UP = "IntegCartPoleSwingUp-v0"


@pytest.fixture(autouse=True)
def _installed():
    needs("dart")


def test_resting_bodies_are_not_put_to_sleep():
    setup = setup_of(*ENGINE, SWING_UP, contact="engine")
    assert not setup.engine._world.getDeactivationOptions().mEnabled


def test_what_is_astray_is_not_hidden(capfd):
    """DART would warn, and go on without accelerations that are not finite."""
    setup = setup_of(*ENGINE, "IntegCartPole-v0")
    run = setup.engine.run(3)
    for value in (np.nan, np.inf, 1e300):
        for place in range(6):
            values = [0.1] * 6
            values[place] = value
            assert np.isnan(run(*values)).all()
    assert capfd.readouterr() == ("", "")
