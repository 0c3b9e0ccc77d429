"""Examples in docstrings run."""

from __future__ import annotations

import doctest
import importlib
import pkgutil

import pytest
from house import FLOORS

MODULES = sorted(
    module.name
    for floor in FLOORS[:-1]
    for module in pkgutil.walk_packages(
        importlib.import_module(f"integ_gym.{floor}").__path__, f"integ_gym.{floor}."
    )
)


@pytest.mark.parametrize("name", MODULES)
def test_examples(name):
    found = doctest.testmod(importlib.import_module(name), raise_on_error=False)
    assert found.failed == 0
    assert found.attempted or not name.endswith(("catalogue.pendulum", "catalogue.cart_pole"))
