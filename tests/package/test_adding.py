"""docs/how-to/adding.md: its files work together as they stand on the page."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import integ_gym  # noqa: F401
from integ_gym.evidence import fields, table
from integ_gym.evidence import fields as trace_fields
from integ_gym.evidence import record as summary
from integ_gym.evidence import schema as arrow_schema
from integ_gym.evidence.labels import EpisodeContext
from integ_gym.evidence.recorder import RecordEvidence
from integ_gym.evidence.store import EvidenceStore

ROOT = Path(__file__).parent.parent.parent
PAGE = (ROOT / "docs" / "how-to" / "adding.md").read_text(encoding="utf-8")


def _blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)


@pytest.fixture(scope="module")
def directory(tmp_path_factory) -> Path:
    """A directory with the page's files."""
    folder = tmp_path_factory.mktemp("adding")
    for block in _blocks("python"):
        (name,) = re.findall(r"\A# (\w+\.py)$", block, re.MULTILINE)
        (folder / name).write_text(block, encoding="utf-8")
    return folder


def _run(directory: Path, *words: str) -> str:
    done = subprocess.run(
        [sys.executable, "-W", "error", *words],
        cwd=directory,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_task_runs(directory):
    printed = _run(directory, "use_task.py")
    assert re.search(r"x = -?\d\.\d{3} m", printed)
    assert "(8, 2)" in printed


def test_the_command_tells_the_integrator_what_it_is(directory):
    (command,) = _blocks("sh")
    words = shlex.split(command)
    assert words[0] == "integ-gym"
    printed = _run(directory, "-m", "integ_gym.cli", *words[1:], "--all", "--no-progress")
    rows = {" ".join(row.split()) for row in printed.splitlines()}
    (told,) = [block for block in _blocks("text") if not block.startswith("integ-gym")]
    for row in told.splitlines():
        assert " ".join(row.split()) in rows
    assert "my_plant:Slider, plant: rate of energy" in printed
    assert (directory / "runs" / "ralston" / "diagnose.json").exists()


def test_parts_of_ones_own_need_the_users_door_alone():
    imported = re.findall(r"^(?:from|import) (integ_gym\S*)", "\n".join(_blocks("python")), re.M)
    assert imported
    assert set(imported) == {"integ_gym"}


def test_the_page_names_folders_that_exist():
    for path in re.findall(r"`((?:envs|train|eval)/[\w/]+\.py)`", PAGE):
        example = Path(path).name in ("slider.py", "ralston.py", "settle.py")
        assert (ROOT / path).parent.is_dir() if example else (ROOT / path).exists(), path


def test_an_evidence_field_is_one_entry(monkeypatch, tmp_path):
    """Both entries of the page, put into their tables, are recorded."""
    field = eval(re.findall(r"^(_real\(.*\)),$", PAGE, re.MULTILINE)[0], vars(fields))
    column = eval(re.findall(r"^(_column\(.*\)),$", PAGE, re.MULTILINE)[0], vars(trace_fields))
    summaries = (*fields.SUMMARY_FIELDS, field)
    for module in (fields, trace_fields, summary, table):
        monkeypatch.setattr(module, "SUMMARY_FIELDS", summaries)
    names = frozenset(one.name for one in summaries)
    monkeypatch.setattr(arrow_schema, "_SUMMARY_NAMES", names)
    monkeypatch.setattr(trace_fields, "COMMON_TRACE", (*trace_fields.COMMON_TRACE, column))
    env = gym.make("IntegPendulum-v0", duration=0.5)
    env = RecordEvidence(env, tmp_path, EpisodeContext("run", "cell"))
    env.reset(seed=0)
    for torque in 5 * (2.0, 0.0):
        env.step(np.array([torque], dtype=np.float32))
    env.close()
    (record,) = EvidenceStore(tmp_path).records()
    assert record[field.name] == record["energy"].max()
    assert record[column.name].tolist() == 5 * [1, 0]
    assert EvidenceStore(tmp_path).verify() == []
