"""The command line as a whole."""

from __future__ import annotations

import importlib
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

import integ_gym
from integ_gym.cli import COMMANDS, main


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_with_examples(command, capsys):
    with pytest.raises(SystemExit) as ended:
        main([command, "--help"])
    assert ended.value.code == 0
    text = capsys.readouterr().out
    assert f"integ-gym {command}" in text
    assert "example" in text


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
def test_the_examples_of_every_help_are_understood(command):
    made = importlib.import_module(f"integ_gym.commands.{command}").parser()
    examples = _examples(made.epilog)
    assert examples
    for words in examples:
        assert words[:2] == ["integ-gym", command]
        made.parse_args(words[2:])


def test_main_help_lists_the_commands(capsys):
    with pytest.raises(SystemExit) as ended:
        main([])
    assert ended.value.code == 0
    text = capsys.readouterr().out
    for command in COMMANDS:
        assert f"  {command}" in text


def test_unknown_command_ends_with_the_choices(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["pannel"])
    assert ended.value.code == 2
    error = capsys.readouterr().err
    assert "panel" in error
    assert error.count("\n") == 1


def test_version_is_printed(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    assert ended.value.code == 0
    assert capsys.readouterr().out == f"integ-gym {integ_gym.__version__}\n"


@pytest.mark.parametrize("command", COMMANDS)
def test_missing_arguments_end_with_one_line(command, capsys):
    with pytest.raises(SystemExit) as ended:
        main([command, "--no-such-flag"])
    assert ended.value.code == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "--help" in error


def test_installed_command_runs():
    done = subprocess.run(
        [sys.executable, "-m", "integ_gym.cli", "train", "--env", "Nowhere-v0", "--out", "unused"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "IntegPendulum-v0" in done.stderr
    assert "Traceback" not in done.stderr


def test_programming_errors_keep_their_traceback(monkeypatch):
    import integ_gym.commands.report as command

    monkeypatch.setattr(command, "main", lambda argv: int("x"))
    with pytest.raises(ValueError, match="invalid literal"):
        main(["report"])


def test_the_installed_command_finds_an_integrator_beside_it(tmp_path):
    (tmp_path / "mine.py").write_text(
        "from integ_gym.envs.integrators.rk4 import RK4\n\n\nclass Own(RK4):\n    pass\n"
    )
    small = ["--total-steps", "64", "--n-envs", "2", "--n-steps", "16", "--batch-size", "32"]
    done = subprocess.run(
        [
            Path(sys.executable).with_name("integ-gym"), "train", "--integrator", "mine:Own",
            "--no-progress", "--no-tensorboard", "--out", "policy", *small,
        ],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "policy" / "policy.zip").exists()


def _ends_without_a_reader(*argv: str, both: bool = False) -> tuple[int, bytes]:
    """Exit code and standard error of a command whose output nobody reads."""
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-m", "integ_gym.cli", *argv]
    done = subprocess.run(
        command, stdout=write, stderr=write if both else subprocess.PIPE, check=False
    )
    os.close(write)
    return done.returncode, done.stderr or b""


@pytest.mark.parametrize(
    "argv",
    [
        ["--help"],
        ["--version"],
        ["train", "--help"],
        ["engines", "--engine", "native"],
        ["engines", "--engine", "native", "--json"],
    ],
    ids=" ".join,
)
def test_a_reader_that_has_seen_enough_is_no_error(argv):
    code, error = _ends_without_a_reader(*argv)
    assert code == 0
    assert error in (b"", "measuring native …\n".encode())


def test_a_reader_of_messages_that_has_seen_enough_is_no_error():
    assert _ends_without_a_reader("engines", "--engine", "native", both=True)[0] == 0


def test_a_pipe_that_breaks_within_is_an_error(monkeypatch):
    import integ_gym.commands.report as command

    def fails(argv):
        raise BrokenPipeError("a worker's")

    monkeypatch.setattr(command, "main", fails)
    monkeypatch.setattr(sys, "stdout", sys.__stdout__)
    monkeypatch.setattr(sys, "stderr", sys.__stderr__)
    with pytest.raises(BrokenPipeError, match="a worker's"):
        main(["report"])
