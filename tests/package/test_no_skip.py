"""``pytest --no-skip``: what continuous integration relies on."""

import doctest
import importlib
import os
import pkgutil
import subprocess
import sys
from itertools import combinations, product
from pathlib import Path

import pytest
from house import FLOORS
from pairing import covering

TESTS = """
import pytest

def test_skipped():
    pytest.skip("for lack of something")

@pytest.mark.skipif(True, reason="never")
def test_marked():
    pass

def test_passes():
    pass
"""


def test_a_skipped_test_fails(tmp_path):
    (tmp_path / "test_some.py").write_text(TESTS, encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-p", "conftest", "--no-skip", str(tmp_path)]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 1, done.stdout
    assert "for lack of something" in done.stdout
    assert "1 passed" in done.stdout


AXES = ("abcd", "xyz", (1, 2))


@pytest.mark.parametrize("strength", [1, 2, 3])
def test_every_combination_is_there_and_the_quick_ones_let_values_meet(strength):
    made = covering(*AXES, strength=strength)
    assert [one.values for one in made] == list(product(*AXES))
    quick = [one.values for one in made if not one.marks]
    for axes in combinations(range(3), strength):
        met = {tuple(values[k] for k in axes) for values in quick}
        assert met == set(product(*(AXES[k] for k in axes)))
    assert len(quick) <= (4, 14, 24)[strength - 1]
    assert all([mark.name for mark in one.marks] in ([], ["slow"]) for one in made)


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
