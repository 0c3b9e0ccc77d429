"""A run is pushed to the Hub, and a policy judged from there, through the Hub's own library."""

import os
import re
import subprocess
import sys

import pytest
import yaml
from loopback_hub import loopback_hub

from integ_gym.eval.panel.result import read_panel
from integ_gym.train.policy_files.hub import choose_policy


@pytest.fixture
def hub():
    with loopback_hub() as server:
        yield server


@pytest.fixture
def command(hub, tmp_path):
    """Runs a command in a process whose Hub is the one on loopback."""

    def run(*words: object, **told: str) -> subprocess.CompletedProcess[str]:
        line = [sys.executable, "-m", "integ_gym.cli", *map(str, words)]
        own = {**os.environ, **hub.told, "HF_HOME": str(tmp_path / "home"), **told}
        return subprocess.run(line, cwd=tmp_path, env=own, capture_output=True, text=True)

    return run


@pytest.mark.slow
def test_a_run_is_pushed_and_its_policy_judged_from_there(panel_directory, hub, command, tmp_path):
    refused = command("share", panel_directory, "--repo", "me/runs")
    assert refused.returncode == 2
    assert "HF_TOKEN" in refused.stderr
    assert not hub.files

    done = command("share", panel_directory, "--repo", "me/runs", HF_TOKEN="hf_secret")
    assert done.returncode == 0, done.stderr
    assert {kind for kind, _ in hub.files} == {"model", "dataset"}
    assert hub.tokens == {"Bearer hf_secret"}
    panel = read_panel(panel_directory / "panel.json")
    for (kind, _), files in hub.files.items():
        folder = panel_directory / ("policies" if kind == "model" else "")
        for path in folder.rglob("*"):
            if path.is_file():
                assert files[path.relative_to(panel_directory).as_posix()] == path.read_bytes()
        card = files["README.md"].decode()
        metadata = yaml.safe_load(card.split("---\n")[1])
        assert "integ-gym" in metadata["tags"]
        assert panel.headline in card
        for entry in panel.matrix:
            if entry.cell in {cell.name for cell in panel.columns}:
                assert str(entry.success) in card
        assert b"hf_secret" not in b"".join(files.values())
    card = hub.files["model", "me/runs"]["README.md"].decode()
    assert yaml.safe_load(card.split("---\n")[1])["model-index"][0]["results"]
    words = re.search(r"^integ-gym (evaluate hf://.+)$", card, re.MULTILINE)[1].split()
    few = ("--episodes", 2, "--integrator", "rk4", "--dt", 0.05, "--workers", 1, "--no-progress")
    judged = command(*words, *few)
    assert judged.returncode == 0, judged.stderr
    again = command(
        "evaluate", panel_directory / words[1].split("me/runs/")[1], *words[2:-1], "again", *few
    )
    assert again.returncode == 0, again.stderr
    matrices = [read_panel(tmp_path / run / "panel.json").matrix for run in ("judged", "again")]
    assert [one.success for one in matrices[0]] == [one.success for one in matrices[1]]
    assert [one.returns for one in matrices[0]] == [one.returns for one in matrices[1]]


ONE = {"ppo-x.zip": b"1", "train_eval_metrics.zip": b"2"}


@pytest.mark.parametrize(
    ("files", "place", "told"),
    [
        ({}, "hf://me/nothing", "the Hub shows you no hf://me/nothing (status 404)"),
        ({"README.md": b"."}, "hf://me/x", "holds no policy"),
        (ONE, "hf://me/x", "holds several policies"),
        (ONE, "hf://me/x/ppo-y.zip", "has no file ppo-y.zip"),
        (ONE, "hf://me", "expected hf://USER/REPO"),
    ],
)
def test_what_is_not_on_the_hub_is_refused_in_a_sentence(files, place, told, hub, command):
    if files:
        hub.files["model", "me/x"] = files
    done = command("evaluate", place, "--env", "IntegPendulum-v0", "--out", "out")
    assert done.returncode == 2
    assert told in " ".join(done.stderr.split())


def test_the_only_policy_or_that_of_the_repository_s_name_is_meant():
    assert choose_policy([*ONE, "README.md"], "me/ppo-x") == "ppo-x.zip"
    assert choose_policy(["a/policy.onnx", "a/policy.json"], "me/other") == "a/policy.onnx"
