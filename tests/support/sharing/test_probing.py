"""A file system on which claims would not hold is refused in a sentence."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from integ_gym.support.processes.locks import FileLock
from integ_gym.support.sharing import folder_files
from integ_gym.support.sharing.probing import check_sharing


def test_this_file_system_can_be_shared(tmp_path):
    check_sharing(tmp_path)
    assert not list(tmp_path.iterdir())


def _link_that_replaces(source, target):
    Path(target).write_bytes(Path(source).read_bytes())


def _no_links(source, target):
    raise OSError(errno.EPERM, os.strerror(errno.EPERM))


FAULTS = {
    "links that replace": (folder_files.os, "link", _link_that_replaces, "can make one file"),
    "no links": (folder_files.os, "link", _no_links, "can make one file"),
    "no renaming": (os, "replace", lambda old, new: None, "does not take another's place"),
    "no locks": (FileLock, "acquire", lambda self, shared=False: True, "locks do not hold"),
    "no times": (folder_files.FolderFiles, "age", lambda self, name: 0.0, "no times"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_what_claims_rest_on_is_tried(fault, tmp_path, monkeypatch):
    owner, name, broken, told = FAULTS[fault]
    monkeypatch.setattr(owner, name, broken)
    with pytest.raises(ValueError, match="cannot be shared") as refused:
        check_sharing(tmp_path)
    assert told in str(refused.value)
    assert "give a directory on another one" in str(refused.value)
    monkeypatch.undo()
    assert not list(tmp_path.iterdir())
