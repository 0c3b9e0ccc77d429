"""Examples in docstrings run."""

from __future__ import annotations

import doctest
import importlib
import pkgutil

import pytest

import integ_gym.envs
import integ_gym.eval
import integ_gym.evidence
import integ_gym.support
import integ_gym.train

MODULES = sorted(
    module.name
    for package in (
        integ_gym.support,
        integ_gym.envs,
        integ_gym.evidence,
        integ_gym.train,
        integ_gym.eval,
    )
    for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
)


@pytest.mark.parametrize("name", MODULES)
def test_examples(name):
    results = doctest.testmod(importlib.import_module(name), raise_on_error=False)
    assert results.failed == 0


def test_environments_have_examples():
    for name in ("pendulum", "cart_pole"):
        module = importlib.import_module(f"integ_gym.envs.catalogue.{name}")
        assert doctest.testmod(module).attempted > 0
