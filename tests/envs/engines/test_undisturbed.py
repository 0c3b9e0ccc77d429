"""The first import of a simulator leaves no trace in the process but the module."""

from __future__ import annotations

import os
import sys

import pytest

from integ_gym.envs.engines.simulator import load_undisturbed

NOISY = """
import os, warnings
os.write(2, b"banner of version 1\\nsomething else\\n")
os.environ["NOISY"] = "1"
os.environ["KEPT"] = "2"
warnings.warn("look out")
"""


@pytest.fixture
def noisy(tmp_path, monkeypatch):
    """Name of a module that is noisy when it is imported."""
    (tmp_path / "noisy_simulator.py").write_text(NOISY)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("KEPT", "1")
    yield "noisy_simulator"
    sys.modules.pop("noisy_simulator", None)


def test_what_an_import_writes_is_not_shown(noisy, capfd):
    module = load_undisturbed(noisy, "mujoco")
    assert module is sys.modules[noisy]
    assert capfd.readouterr() == ("", "")


def test_environment_variables_stay_as_they_were(noisy):
    before = dict(os.environ)
    load_undisturbed(noisy, "mujoco")
    assert dict(os.environ) == before


def test_standard_error_is_whole_again_after_a_failed_import(capfd):
    with pytest.raises(ModuleNotFoundError, match=r'pip install -e "\.\[mujoco\]"'):
        load_undisturbed("no_such_simulator", "mujoco")
    os.write(2, b"banner\n")
    assert capfd.readouterr().err == "banner\n"
