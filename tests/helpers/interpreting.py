"""Interpreters that are this one with a further package, and what is called in them."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import numpy as np

from integ_gym.support.interpreters import Interpreter, _own, interpreters_folder, needed_versions
from integ_gym.support.processes import report_work

TINY = ("tiny==1.0",)


def fake_interpreter(folder: Path, packages=TINY, found=TINY) -> Interpreter:
    """One that is this one, and finds other packages too, as if it had been made."""
    for one in found:
        name, _, version = one.partition("==")
        info = folder / "site" / f"{name}-{version}.dist-info"
        info.mkdir(parents=True)
        text = f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n"
        (info / "METADATA").write_text(text, encoding="utf-8")
    made = interpreters_folder() / "fake"
    python = made / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text(f'#!/bin/sh\nPYTHONPATH={folder / "site"} exec {sys.executable} "$@"\n')
    python.chmod(0o755)
    versions = {**needed_versions(["mujoco"]), **dict(one.split("==") for one in packages)}
    marker = {"own": _own(), "packages": list(packages), "versions": versions}
    (made / "interpreter.json").write_text(json.dumps(marker), encoding="utf-8")
    return Interpreter(made, tuple(packages))


def count(until, fault=None):
    """Numbers, one after the other, and then perhaps a fault."""
    for number in range(until):
        report_work(0.5)
        yield number, os.getpid()
    if fault == "ends":
        os._exit(3)
    if fault is not None:
        raise fault


def push(observation):
    """Balances a cart-pole at home, and hardly with late commands."""
    return int(observation[2] + 0.3 * observation[3] > 0.0)


def balance(observation):
    """Balances MuJoCo's inverted pendulum."""
    return np.array([observation @ [1.0, 10.0, 1.5, 3.0]])
