"""Files and words of commands: read whole or refused in one sentence, and told without paths."""

import ctypes
import errno
import io
import os
import re
import shlex
import signal
import subprocess
from argparse import ArgumentTypeError
from pathlib import Path

import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from integ_gym.support.errors import InputError, MissingPackageError
from integ_gym.support.files import (
    DEEPEST,
    check_regular,
    display_path,
    read_bounded,
    read_object,
)
from integ_gym.support.options import display_command, named_value, whole_number
from integ_gym.support.terminal import (
    DEFECT,
    WorkBar,
    compact,
    compact_percent,
    fixed,
    percent,
    print_command,
    report_errors,
    seconds,
    width_of,
    wrap,
)

KINDS = {"name": str, "seconds": float, "parts": (list, type(None))}
WHOLE = '{"name": "a", "seconds": 1, "parts": null}'

DAMAGED = {
    "cut": (WHOLE[:20], "is damaged"),
    "list": ("[1]", "a list where an object was expected"),
    "empty": ("{}", "it lacks 'name'"),
    "text": ('{"name": "a", "seconds": "1", "parts": []}', "'seconds' must be a number, got text"),
    "flag": ('{"name": "a", "seconds": true, "parts": []}', "must be a number, got true or false"),
    "kind": ('{"name": "a", "seconds": 1, "parts": 3}', "must be a list or null, got a whole"),
    "deep": (f'{{"a": {"[" * 100_000}{"]" * 100_000}}}', f"more than {DEEPEST} deep"),
    "deeper": (f'{{"a": {"[" * 70}{"]" * 70}}}', f"more than {DEEPEST} deep"),
    "digits": (f'{{"a": {"1" * 5000}}}', "has 5000 digits"),
    "float": ('{"a": 1e400}', "the number 1e400 is not finite"),
    "nan": ('{"a": NaN}', "the number NaN is not finite"),
    "bytes": (b'{"a": "\xff"}', "is damaged"),
}


@pytest.mark.parametrize("fault", DAMAGED)
def test_what_is_damaged_is_named_with_the_remedy(tmp_path, fault):
    file = tmp_path / "a.json"
    file.write_text(WHOLE)
    assert read_object(file, KINDS, "") == {"name": "a", "seconds": 1, "parts": None}
    content, message = DAMAGED[fault]
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(ValueError) as refused:
        read_object(file, KINDS, "restore it")
    told = str(refused.value)
    assert told.startswith(str(file))
    assert message in told
    assert told.endswith("; restore it")


@settings(deadline=None, max_examples=50)
@given(content=st.binary(max_size=200))
def test_any_bytes_are_read_or_refused(tmp_path_factory, content):
    file = tmp_path_factory.mktemp("any") / "a.json"
    file.write_bytes(content)
    with pytest.raises(ValueError, match="restore it"):
        read_object(file, KINDS, "restore it")


def test_what_is_missing_too_long_or_endless_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"cannot read .*: No such file .*; restore it"):
        read_object(tmp_path / "a.json", {}, "restore it")
    with (tmp_path / "long").open("wb") as sparse:
        sparse.truncate(1 << 40)
    with pytest.raises(ValueError, match="has more than 1000 bytes"):
        read_bounded(tmp_path / "long", 1000)
    pipe = tmp_path / "pipe.json"
    os.mkfifo(pipe)
    for path in (Path("/dev/zero"), pipe):
        with pytest.raises(OSError, match="it is a device or a pipe and no file"):
            read_bounded(path)
        with pytest.raises(ValueError, match=r"cannot read .* a device or a pipe .*; restore it$"):
            read_object(path, {}, "restore it")
    with pytest.raises(IsADirectoryError):
        check_regular(tmp_path)


def test_paths_and_commands_are_told_from_here_or_by_their_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert display_path("runs/panel") == "runs/panel"
    assert display_path(tmp_path / "runs" / "panel") == "runs/panel"
    assert display_path(Path("/home/somebody/runs/panel")) == "panel"
    words = ["integ-gym", "panel", "/a/b.toml", f"--out={tmp_path}/one two", "--home", "dt=1,x=/y"]
    assert display_command(words) == "integ-gym panel b.toml '--out=one two' --home dt=1,x=/y"


@pytest.mark.parametrize("word", ["1.5", "1e-3", "many", "nan", "1e999"])
def test_what_is_no_whole_number_is_refused(word):
    assert whole_number("2.5e3") == 2500
    with pytest.raises(ArgumentTypeError, match=f"expected a whole number.*{word}"):
        whole_number(word)
    assert named_value("a=" + "[" * 100_000)[1].startswith("[[")


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


@pytest.mark.parametrize("width", range(24, 80, 7))
def test_a_command_that_goes_on_is_one_for_the_shell(width, monkeypatch, capsys):
    words = [
        "evaluate",
        "--force",
        *(f"--argument-{k} {k}" for k in range(5)),
        "'two  words --or 3'",
    ]
    command = " ".join(["integ-gym", *words])
    monkeypatch.setenv("COLUMNS", str(width))
    print_command(command)
    shown = capsys.readouterr().out
    assert max(map(len, shown.splitlines())) <= max(width, 29)
    for k in range(5):
        assert f"--argument-{k} {k}" in shown
    script = f"integ-gym() {{ printf '<%s>' \"$@\"; }}; {shown}"
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout == "".join(f"<{word}>" for word in shlex.split(command)[1:])
    monkeypatch.delenv("COLUMNS")
    print_command(command)
    assert capsys.readouterr().out == f"  {command}\n"


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


def test_what_is_left_is_told_by_all_that_was_done(capsys):
    with WorkBar("work", 100.0, shown=True) as bar:
        bar.begin_at(20.0)
        bar._progress.tasks[0].start_time -= 60.0
        bar.describe("the first units")
        assert " left" not in capsys.readouterr().err
        bar.update(2.0)
        bar.update(2.0)  # which ended at the same time
        bar.describe("others")
        assert "about 19 min" in capsys.readouterr().err


def test_a_full_bar_and_how_it_went_fit_a_terminal(monkeypatch, capsys):
    for name, value in {"FORCE_COLOR": "1", "TERM": "xterm", "COLUMNS": "80"}.items():
        monkeypatch.setenv(name, value)
    with WorkBar("PPO, 1 policy", 8192.0, shown=True, unit=" steps") as bar:
        bar.describe("return −1281.2, success 0.00")
    *_, line = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", capsys.readouterr().err).split("\r")
    assert re.fullmatch(
        r"PPO, 1 policy ━{6,} 100%, .*, return −1281.2, success 0.00 *", line.rstrip()
    )
    assert len(line.rstrip()) <= 80
    assert "so far" not in line


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
