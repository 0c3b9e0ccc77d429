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


def test_an_import_writes_nothing_and_leaves_the_environment_as_it_was(
    tmp_path, monkeypatch, capfd
):
    (tmp_path / "noisy_simulator.py").write_text(NOISY)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("KEPT", "1")
    before = dict(os.environ)
    assert load_undisturbed("noisy_simulator", "mujoco") is sys.modules.pop("noisy_simulator")
    assert dict(os.environ) == before
    with pytest.raises(ModuleNotFoundError, match=r'pip install -e "\.\[mujoco\]"'):
        load_undisturbed("no_such_simulator", "mujoco")
    assert capfd.readouterr() == ("", "")
    os.write(2, b"banner\n")
    assert capfd.readouterr().err == "banner\n"
