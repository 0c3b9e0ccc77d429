"""How a command ends."""

from __future__ import annotations

import ctypes
import errno
import signal

import pyarrow as pa
import pytest

from integ_gym.support.errors import InputError, MissingPackageError
from integ_gym.support.terminal import DEFECT, report_errors

CALLBACK = ctypes.CFUNCTYPE(None)


@pytest.fixture(autouse=True)
def _heeded():
    """Where tests run in the background, SIGINT is ignored; here it is not."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def _swallowed():
    """Interrupt inside a callback of compiled code, which cannot raise what it raises."""

    def interrupted():
        signal.raise_signal(signal.SIGINT)

    CALLBACK(interrupted)()
    return 0


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_an_interruption_that_compiled_code_swallows_is_no_success(capsys):
    held = signal.getsignal(signal.SIGINT)
    assert report_errors("a", _swallowed) == 130
    assert "a: interrupted" in capsys.readouterr().err
    assert signal.getsignal(signal.SIGINT) is held


def test_an_interruption_is_raised_where_it_comes(capsys):
    def interrupted():
        signal.raise_signal(signal.SIGINT)
        raise AssertionError("went on")

    assert report_errors("a", interrupted) == 130


def test_without_one_the_code_is_the_commands():
    assert report_errors("a", lambda: 3) == 3


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        pa.ArrowMemoryError("malloc of size 64 failed"),
        pa.ArrowException("Unknown error: std::bad_alloc"),
        OSError(errno.ENOMEM, "Cannot allocate memory"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_memory_that_is_short_is_said_in_a_sentence(error, capsys):
    def run():
        raise error

    assert report_errors("a", run) == 2
    told = capsys.readouterr().err
    assert "a: there is not enough memory" in told
    assert "fewer --workers" in " ".join(told.split())


@pytest.mark.parametrize(
    "error", [InputError("b"), MissingPackageError("b"), FileNotFoundError(2, "b", "c")]
)
def test_what_a_user_can_mend_is_one_line(error, capsys):
    def run():
        raise error

    assert report_errors("a", run) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("error", [ValueError("b"), TypeError("b"), KeyError("b")])
def test_any_other_error_is_a_defect(error):
    def run():
        raise error

    with pytest.raises(type(error)) as raised:
        report_errors("a", run)
    assert raised.value.__notes__ == [DEFECT]
