"""The command line as a whole."""

from __future__ import annotations

import subprocess
import sys

import pytest

from integ_gym.cli import COMMANDS, main


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_with_examples(command, capsys):
    with pytest.raises(SystemExit) as ended:
        main([command, "--help"])
    assert ended.value.code == 0
    text = capsys.readouterr().out
    assert f"integ-gym {command}" in text
    assert "example" in text


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
    assert "panel" in capsys.readouterr().err


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
    import integ_gym.eval.report_command as command

    monkeypatch.setattr(command, "main", lambda argv: int("x"))
    with pytest.raises(ValueError, match="invalid literal"):
        main(["report"])
