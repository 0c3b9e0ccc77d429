"""Interpreters with other package versions: what is asked for, uv's refusals, calls in them."""

import os

import pytest
from interpreting import TINY, count, fake_interpreter

from integ_gym.support import interpreters
from integ_gym.support.errors import InputError, MissingPackageError
from integ_gym.support.interpreters import (
    InterpreterError,
    call_there,
    make_interpreter,
    parse_packages,
)
from integ_gym.support.processes import reporting


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """A cache of its own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_exact_versions_have_one_form():
    assert parse_packages(["MuJoCo == 3.2.7", "a_b==1.0+cpu"]) == ("mujoco==3.2.7", "a-b==1.0+cpu")


@pytest.mark.parametrize(
    "words",
    [[], [3], ["mujoco"], ["mujoco>=3"], ["a==1", "A==2"], ["python==3.9"], ["integ-gym==1"]],
)
def test_anything_else_is_refused(words):
    with pytest.raises(InputError, match="packages"):
        parse_packages(words)


def test_without_uv_the_extra_is_named(monkeypatch):
    monkeypatch.setattr(interpreters.importlib.util, "find_spec", lambda name: None)
    monkeypatch.setenv("PATH", os.devnull)
    with pytest.raises(MissingPackageError, match="versions"):
        make_interpreter(TINY, {})


_UV = """#!/bin/sh
[ "$1" = venv ] && mkdir -p "$4" && exit 0
printf '  × No solution found:\\n  ╰─▶ Because there is no version of tiny==1.0 and\\n' >&2
printf '      you require it, nothing can be done.\\n\\nhint: another line\\n' >&2
exit 1
"""


def test_what_uv_cannot_make_is_refused_in_its_words(tmp_path, monkeypatch, cache):
    (tmp_path / "uv").write_text(_UV, encoding="utf-8")
    (tmp_path / "uv").chmod(0o755)
    monkeypatch.setattr(interpreters, "find_uv", lambda: [str(tmp_path / "uv")])
    told = []
    with pytest.raises(InterpreterError) as refused:
        make_interpreter(TINY, {"numpy": "2.0"}, told.append)
    assert "no version of tiny==1.0 and you require it" in str(refused.value)
    assert told == ["making an interpreter with tiny==1.0"]
    assert not list(cache.rglob("interpreter.json"))
    assert not list(cache.rglob("*.lock"))


def test_results_and_work_come_as_they_are_made(tmp_path):
    made = fake_interpreter(tmp_path)
    with reporting() as work:
        found = list(call_there(made, count, 3))
    assert [number for number, _ in found] == [0, 1, 2]
    assert os.getpid() not in {process for _, process in found}
    assert sum(work) == 1.5


@pytest.mark.parametrize(
    ("fault", "about"),
    [
        (ValueError("a bad value"), "tiny==1.0: a bad value"),
        (AttributeError("no mj_makeM"), "lack what integ-gym asks of them .*mj_makeM"),
        (ModuleNotFoundError("torch", name="torch"), "torch is not in this interpreter"),
        (RuntimeError("odd"), "RuntimeError: odd"),
        ("ends", "ended too early"),
    ],
)
def test_an_error_there_is_one_sentence(tmp_path, fault, about):
    made = fake_interpreter(tmp_path)
    answers = call_there(made, count, 1, fault)
    assert next(answers)[0] == 0
    with pytest.raises(InterpreterError, match=about):
        next(answers)


def test_another_version_there_is_refused(tmp_path):
    made = fake_interpreter(tmp_path, found=("tiny==0.9",))
    with pytest.raises(InterpreterError, match=r"0\.9"):
        list(call_there(made, count, 1))
