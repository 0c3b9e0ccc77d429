"""Files and words of commands: read whole or refused in one sentence, and told without paths."""

from __future__ import annotations

import os
from argparse import ArgumentTypeError
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from integ_gym.support.files import (
    DEEPEST,
    check_regular,
    display_path,
    read_bounded,
    read_object,
)
from integ_gym.support.options import display_command, named_value, whole_number

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
