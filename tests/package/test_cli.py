"""The command line as a whole: help, refusals, closed streams, the table after a panel."""

from __future__ import annotations

import importlib
import os
import re
import shlex
import subprocess
import sys
import warnings
from pathlib import Path
from unittest.mock import Mock

import pytest

import integ_gym
from integ_gym import cli
from integ_gym.cli import COMMANDS, main

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
    [([], [f"  {command}" for command in COMMANDS]), (["--version"], [integ_gym.__version__])],
)
def test_what_there_is_is_said(words, told, capsys):
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 0
    text = capsys.readouterr().out
    assert all(one in text for one in told)


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


@pytest.mark.parametrize(
    ("words", "testbeds"),
    [
        ("diagnose", False),
        ("check --integrator rk4 --dt 0.05", True),
        ("train --integrator rk4", True),
        ("evaluate --policy math:sin", True),
    ],
)
def test_a_hint_lists_what_the_command_takes(words, testbeds, tmp_path, capsys):
    assert main([*words.split(), "--env", "Nope-v0", "--out", str(tmp_path / "x")]) == 2
    assert ('"module:Class"' in capsys.readouterr().err) is testbeds


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


def test_a_warning_is_a_sentence_without_a_line_of_source(monkeypatch, capsys):
    def run(*_):
        warnings.simplefilter("always")
        warnings.warn("a return of -5, and --seeds 2", stacklevel=1)
        return 0

    monkeypatch.setattr(cli, "_run", run)
    assert cli.main(["engines"]) == 0
    assert capsys.readouterr().err == "warning: a return of −5, and --seeds 2\n"
