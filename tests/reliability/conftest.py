"""The runs that are attacked, made once."""

from __future__ import annotations

import pytest
from victim import Victim, make_victim


@pytest.fixture(scope="session")
def victim(made_once) -> Victim:
    """Finished runs, of which every try has a copy of its own."""
    return Victim(made_once("victim", make_victim))
