"""What a terminal is told: tables within its width, numbers, colours, and how a command ends."""

from __future__ import annotations

import ctypes
import errno
import io
import re
import signal

import pyarrow as pa
import pytest

from integ_gym.support.errors import InputError, MissingPackageError
from integ_gym.support.terminal import (
    DEFECT,
    WorkBar,
    compact,
    compact_percent,
    fixed,
    percent,
    report_errors,
    seconds,
    width_of,
    wrap,
)

REASON = "it never reached the goal, with 12% of the control steps saturated, over and over again"


@pytest.mark.parametrize("text", [REASON, "a_" * 60, "x" * 100, '{"a":1.25,"b":[1,2]}' * 9, ""])
@pytest.mark.parametrize("width", [20, 60])
def test_nothing_is_lost_where_a_text_is_broken(text, width, monkeypatch):
    assert width_of(io.StringIO()) is None
    assert wrap(text, io.StringIO()) == text
    monkeypatch.setenv("COLUMNS", str(width))
    assert width_of(io.StringIO()) == width
    lines = wrap(text, io.StringIO()).split("\n")
    assert max(map(len, lines)) <= width
    assert "".join(lines).replace(" ", "") == text.replace(" ", "")


def test_numbers_keep_two_digits_and_have_true_minus_signs():
    values = (8.04, 0.0995, -13.2, 1234.0, -3.04e-12, 0.0, None, float("nan"))
    told = ["+8.0", "+0.10", "−13", "+1200", "−3.0·10⁻¹²", "0", "–", "–"]
    assert [compact(value, 2, True) for value in values] == told
    assert [fixed(-0.25), fixed(-0.001), fixed(0.001, sign=True)] == ["−0.25", "0.00", "0.00"]
    assert [seconds(value) for value in (0.25, 61.0, 7260.0, None)] == [
        "0.25 s", "1 min 1 s", "2 h 1 min", "–",
    ]  # fmt: skip
    assert [percent(0.536), percent(0.0042, 1, sign=True), percent(None)] == ["54 %", "+0.4 %", "–"]
    told = [compact_percent(share, sign=True) for share in (-4.1e-8, 1.73, float("nan"))]
    assert told == ["−4.1·10⁻⁶ %", "+170 %", "–"]


@pytest.fixture
def heeded():
    """Where tests run in the background, SIGINT is ignored; here it is not."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_a_bar_is_not_full_before_the_work_is_done(capsys):
    with WorkBar("work", 10.0, shown=True) as bar:
        bar.update(12.0)
        bar.describe("the last bit")
        assert re.search(r"99%.*nearly done", capsys.readouterr().err)
    assert "100%" in capsys.readouterr().err


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_an_interruption_that_compiled_code_swallows_is_no_success(heeded, capsys):
    """As one in a callback, which cannot raise what it raises."""

    def swallowed():
        ctypes.CFUNCTYPE(None)(lambda: signal.raise_signal(signal.SIGINT))()
        return 0

    held = signal.getsignal(signal.SIGINT)
    assert report_errors("a", swallowed) == 130
    assert "a: interrupted" in capsys.readouterr().err
    assert signal.getsignal(signal.SIGINT) is held
    assert report_errors("a", lambda: 3) == 3


def test_an_interruption_is_raised_where_it_comes(heeded):
    def interrupted():
        signal.raise_signal(signal.SIGINT)
        raise AssertionError("went on")

    assert report_errors("a", interrupted) == 130


def _ended(error):
    def run():
        raise error

    return report_errors("a", run)


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
    assert _ended(error) == 2
    told = " ".join(capsys.readouterr().err.split())
    assert "not enough memory" in told
    assert "fewer --workers" in told


def test_what_a_user_can_mend_is_one_line_and_any_other_error_a_defect(capsys):
    for error in (InputError("b"), MissingPackageError("b"), FileNotFoundError(2, "b", "c")):
        assert _ended(error) == 2
        assert capsys.readouterr().err.count("\n") == 1
    for error in (ValueError("b"), KeyError("b")):
        with pytest.raises(type(error)) as raised:
            _ended(error)
        assert raised.value.__notes__ == [DEFECT]
