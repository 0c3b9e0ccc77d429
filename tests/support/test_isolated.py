"""Environments of their own: the process, what goes wrong with it, and where none is set up."""

import gc
import sys
from pathlib import Path

import pytest

from integ_gym.support.isolated import ISOLATED, IsolatedEnvironment, Worker, WorkerError
from integ_gym.support.optional import running_version

SERVED = """
import os, sys, time

class Served:
    def double(self, x):
        print("a library that prints")
        os.system("echo and its child")
        return 2 * x

    def refuse(self):
        raise ValueError("no such task")

    def fail(self):
        return 1 / 0

    def end(self):
        print("out of memory", file=sys.stderr)
        os._exit(3)

    def sleep(self):
        time.sleep(60.0)

    def babble(self):
        os.write(ANSWERS, b"Warning: what no library should print here\\n")

    def listed(self):
        os.write(ANSWERS, b"[1, 2]\\n")

    def environment(self):
        return [sys.flags.isolated, os.environ["OMP_NUM_THREADS"], sys.stdin.read()]

ANSWERS = 4
"""


@pytest.fixture
def worker(tmp_path, monkeypatch):
    """A process that serves the class above with this Python."""
    served = tmp_path / "served.py"
    served.write_text(SERVED, encoding="utf-8")
    monkeypatch.setenv("INTEG_GYM_EXAMPLE_PYTHON", sys.executable)
    return IsolatedEnvironment("example").start(served)


def test_calls_are_answered_whatever_the_library_prints(worker):
    assert worker.call("double", x=2.5) == 5.0
    assert worker.call("double", x=[0.1, float("inf")]) == [0.1, float("inf")] * 2
    assert worker.call("environment") == [1, "1", ""]


def test_what_is_refused_is_a_value_error_and_the_process_goes_on(worker):
    with pytest.raises(ValueError, match=r"^no such task$"):
        worker.call("refuse")
    with pytest.raises(
        WorkerError, match=r"^example failed in `fail`: ZeroDivisionError: division"
    ):
        worker.call("fail")
    with pytest.raises(WorkerError, match="failed in `missing`: AttributeError"):
        worker.call("missing")
    assert worker.call("double", x=1) == 2


def _ended(worker, method, message, **given):
    """The process is ended by a call, and says so again when it is called once more."""
    for _ in range(2):
        with pytest.raises(WorkerError, match=message):
            worker.call(method, **given)
        method, given = "double", {"x": 1}
    assert worker._process.poll() is not None


def test_a_crash_is_told_with_the_last_words(worker):
    message = "ended with exit code 3 when asked for `end`; its last words: out of memory$"
    _ended(worker, "end", message)


def test_an_answer_that_does_not_come_is_waited_for_so_long(worker):
    _ended(worker, "sleep", "did not answer `sleep` within 0.5 s, and was ended", patience=0.5)


@pytest.mark.parametrize(("method", "quoted"), [("babble", "Warning: what"), ("listed", "1, 2")])
def test_an_answer_that_is_none_is_quoted(worker, method, quoted):
    _ended(worker, method, f"gave no readable answer to `{method}`.*{quoted}")


def test_a_process_ends_with_what_called_it(worker):
    process = worker._process
    worker.close()
    assert process.poll() is not None
    with pytest.raises(WorkerError, match="example was closed"):
        worker.call("double", x=1)


def test_a_process_ends_when_it_is_dropped():
    made = Worker("example", [sys.executable, "-I", "-c", "import sys; sys.stdin.read()"])
    process = made._process
    del made
    gc.collect()
    assert process.poll() is not None


@pytest.mark.parametrize("name", ISOLATED)
def test_one_that_is_not_set_up_is_named_with_what_does_it(name, tmp_path, monkeypatch):
    apart = ISOLATED[name]
    monkeypatch.setenv(apart.variable, str(tmp_path / "python"))
    assert not apart.installed
    assert running_version(name) == "unknown"
    with pytest.raises(ModuleNotFoundError, match=f"run: make {name} .*{apart.variable}") as told:
        apart.start(Path("served.py"))
    assert "\n" not in str(told.value)


def test_its_version_is_that_of_its_interpreter(monkeypatch):
    monkeypatch.setenv("INTEG_GYM_PYTEST_PYTHON", sys.executable)
    assert IsolatedEnvironment("pytest").version() == pytest.__version__
    monkeypatch.delenv("INTEG_GYM_PYTEST_PYTHON")
    assert IsolatedEnvironment("pytest").python.parts[-3:] == (".pytest", "bin", "python")
    assert IsolatedEnvironment("pytest").version() is None
