"""The command line as a whole: help, refusals, closed streams, the table after a panel."""

import importlib
import json
import os
import re
import shlex
import subprocess
import sys
from functools import cache
from pathlib import Path
from unittest.mock import Mock

import pytest

from integ_gym.cli import COMMANDS, main
from integ_gym.envs import numerics
from integ_gym.envs.numerics.identity import fingerprint
from integ_gym.envs.registries import ENGINES

COMMAND = [sys.executable, "-m", "integ_gym.cli"]


def _examples(text: str) -> list[list[str]]:
    """Command lines of an epilog; one that goes on in the next line is joined to it."""
    found: list[str] = []
    for line in text.splitlines():
        if found and (found[-1].endswith("\\") or found[-1].count('"') % 2):
            found[-1] = found[-1].rstrip("\\") + " " + line.strip()
        elif line.startswith("  integ-gym "):
            found.append(re.split(r"\s{3,}", line.strip())[0])
    return [shlex.split(line) for line in found]


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_whose_examples_are_understood(command, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    with pytest.raises(SystemExit) as ended:
        main([command, "--help"])
    assert ended.value.code == 0
    shown = capsys.readouterr().out
    assert f"integ-gym {command}" in shown
    assert [line for line in shown.splitlines() if len(line) > 80] == []
    made = importlib.import_module(f"integ_gym.commands.{command}").parser()
    examples = _examples(made.epilog)
    assert examples
    for words in examples:
        assert words[:2] == ["integ-gym", command]
        made.parse_args(words[2:])


@pytest.mark.parametrize(
    ("words", "told"),
    [(["pannel"], "'panel'"), *(([command, "--no-such-flag"], "--help") for command in COMMANDS)],
)
def test_what_is_not_understood_ends_with_one_line(words, told, capsys):
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2
    error = capsys.readouterr().err
    assert told in error
    assert error.count("\n") == 1


@pytest.mark.parametrize("kind", [ValueError, BrokenPipeError])
def test_programming_errors_keep_their_traceback(kind, monkeypatch):
    """A pipe that breaks within is one too."""
    import integ_gym.commands.report as command

    monkeypatch.setattr(command, "main", Mock(side_effect=kind("a worker's")))
    monkeypatch.setattr(sys, "stdout", sys.__stdout__)
    monkeypatch.setattr(sys, "stderr", sys.__stderr__)
    with pytest.raises(kind, match="a worker's"):
        main(["report"])


def test_the_installed_command_finds_an_integrator_beside_it(tmp_path):
    (tmp_path / "mine.py").write_text("class Own:\n    pass\n")
    words = ["diagnose", "--plant", "pendulum", "--integrator", "mine:Own", "--out", "out"]
    command = [Path(sys.executable).with_name("integ-gym"), *words]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "is not an integrator" in done.stderr


@pytest.mark.parametrize(
    ("words", "both"),
    [("--help", False), ("engines --engine native", False), ("engines --engine native", True)],
)
def test_a_reader_that_has_seen_enough_is_no_error(words, both):
    read, write = os.pipe()
    os.close(read)
    error = write if both else subprocess.PIPE
    done = subprocess.run([*COMMAND, *words.split()], stdout=write, stderr=error, check=False)
    os.close(write)
    assert done.returncode == 0
    assert done.stderr in (None, b"", "measuring native …\n".encode())


@pytest.mark.parametrize(
    ("words", "code", "closed"),
    [
        ("--help", 0, ">&-"),
        ("engines --engine native", 0, ">&- 2>&-"),
        ("evidence query no-such-run SELECT", 2, "<&-"),
        ("evalute", 2, "2>&-"),
    ],
)
def test_a_command_needs_no_standard_streams(words, code, closed, tmp_path):
    """Some schedulers start commands without."""
    line = ["sh", "-c", f'"$@" {closed}', "sh", *COMMAND, *words.split()]
    done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr


WANTING = {
    "panel small.toml --out run": "panel",
    "check --integrator rk4 --dt 0.05": "panel",
    "atlas small.toml": "panel",
    "train --integrator rk4 --dt 0.05 --out policy": "train",
    "train --trainer fleet --integrator rk4 --dt 0.05 --out policy": "fleet",
    "train --trainer=fleet --integrator rk4 --dt 0.05 --out policy": "fleet",
    "evaluate policy.zip --env IntegPendulum-v0 --out run": "report",
    "diagnose --example drift": "report",
    "census --published gymnasium --out run": "report",
    "report run": "report",
    "judge results.csv": "report",
    "watch run 3f9a --out film.gif": "render,report",
    "share run --repo me/run": "report,hub",
    "evidence verify run": "evidence",
}
NAMES = {
    "DiscretizationCallback": "train",
    "train_ppo": "train",
    "train_sac": "train",
    "train_fleet": "fleet",
    "run_panel": "panel",
    "check": "panel",
    "evaluate": "report",
    "read_panel": "report",
    "side_by_side": "render,report",
}
SCRIPT = """
import contextlib, io, json, sys

for name in (
    "pyarrow", "duckdb", "jsonschema", "portalocker", "torch", "stable_baselines3", "safetensors",
    "tensorboard", "rich", "scipy", "threadpoolctl", "jinja2", "matplotlib", "msgspec", "jax",
    "pygame", "PIL", "imageio_ffmpeg", "huggingface_hub",
):
    sys.modules[name] = None

import integ_gym
from integ_gym.cli import main

commands, names = json.loads(sys.argv[1])
hints = {}
for words in commands:
    with contextlib.redirect_stderr(io.StringIO()) as said:
        code = main(words.split())
    hints[words] = f"{code} {said.getvalue()}"
for name in names:
    try:
        getattr(integ_gym, name)
        hints[name] = "nothing is missing"
    except ModuleNotFoundError as error:
        hints[name] = str(error)
print(json.dumps(hints))
"""


def test_a_hint_names_the_smallest_extra_that_helps(tmp_path):
    line = [sys.executable, "-c", SCRIPT, json.dumps([list(WANTING), list(NAMES)])]
    done = subprocess.run(line, capture_output=True, text=True, cwd=tmp_path, check=True)
    hints = json.loads(done.stdout)
    wrong = {
        use: hints[use]
        for use, extra in {**WANTING, **NAMES}.items()
        if f'pip install -e ".[{extra}]"' not in hints[use]
    }
    assert wrong == {}
    assert all(hints[words].startswith("2 ") for words in WANTING)


@pytest.fixture(scope="module")
def of_native():
    """Runs the command on the native engine, whose steps are measured once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(numerics, "fingerprint", cache(fingerprint))
        yield lambda *more: main(["engines", "--engine", "native", *more])


def test_the_document_has_everything_measured(of_native, capsys):
    assert of_native("--json") == 0
    printed = capsys.readouterr().out
    assert "not applicable: generalized coordinates" in printed
    document = json.loads(printed)
    found = {entry["integrator"]: entry for entry in document["installed"]}
    assert found["rk4"]["map"] == "rk4"
    assert found["rk4"]["order"] == pytest.approx(4.0, abs=0.05)
    assert found["explicit_euler"]["energy_rate"] > 0.2
    assert found["implicit_euler"]["energy_rate"] < -0.2
    assert document["missing"] == {}


def test_what_is_missing_is_named_with_its_remedy(of_native, capsys, monkeypatch):
    monkeypatch.setattr(ENGINES.load("mujoco"), "modules", ("no_such_module",))
    assert of_native("mujoco") == 0
    out = capsys.readouterr().out
    assert 'no_such_module); run: pip install -e ".[mujoco]"' in out
