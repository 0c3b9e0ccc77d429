"""The README's code blocks run, and what it links to exists."""

import json
import re
import shlex
import subprocess
import sys
import types

import gymnasium as gym
import numpy as np
import pytest
from house import ROOT, page_blocks, page_text

from integ_gym.cli import COMMANDS

DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
README = page_text("README.md")


def test_python_blocks_run_and_print_what_is_shown_below_them():
    shown = dict(re.findall(r"^```python\n(.*?)^```\s+^```text\n(.*?)^```", README, re.S | re.M))
    assert shown
    for block in page_blocks("README.md", "python"):
        done = subprocess.run(
            [sys.executable, "-W", "error", "-c", block],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert done.stdout
        assert done.stdout == shown.get(block, done.stdout)


MIXTURE, PERIODS, LANES, SERVO, INTEGRATOR = page_blocks("docs/reference/environments.md", "python")


def test_the_documented_mixture_and_lanes_run(capsys):
    exec(MIXTURE, {})
    assert set(re.findall(r"\d+", capsys.readouterr().out)) == {"0", "1"}
    names = {}
    exec(PERIODS, names)
    assert names["env"].spec.max_episode_steps == 200
    assert str(names["env"].unwrapped.setup.timing.control_period) in capsys.readouterr().out
    exec(LANES, names)
    assert names["observations"].shape == (64, 3)
    assert names["info"]["time"] == pytest.approx(100 * 0.05)
    exec(SERVO, names)
    names["env"].reset(seed=0)
    assert "theta_effort" in names["env"].step(names["env"].action_space.sample())[4]


def test_the_documented_integrator_has_its_order():
    """The example of an integrator of one's own, taken from the page and measured."""
    module = types.ModuleType("documented")
    exec(INTEGRATOR, vars(module))
    sys.modules["documented"] = module
    errors = []
    for dt in (0.01, 0.005):
        ends = []
        for integrator in ("documented:Heun", "reference"):
            env = gym.make("IntegPendulum-v0", integrator=integrator, dt=dt, control_period=0.1)
            env.reset(options={"state": (2.0, 1.0)})
            env.step([1.0])
            ends.append(env.unwrapped.state)
        errors.append(np.abs(ends[0] - ends[1]).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)


def test_what_the_quick_panel_found_is_what_was_saved():
    summary = json.loads((ROOT / "docs" / "quick_panel.json").read_text(encoding="utf-8"))
    rows = {row["row"]: row["cells"]["reference dt=0.05"]["success"] for row in summary["rows"]}
    home = {row["row"]: row["home"][0] for row in summary["rows"]}
    text = " ".join(README.split())
    lossy, fine = "symplectic_euler dt=0.05", "explicit_euler dt=0.0125"
    rate, low, high = (f"{100 * value:.0f}" for value in rows[lossy])
    told = f"in {100 * home[lossy]:.0f} % of the episodes there and in {rate} % ({low} to {high} %)"
    assert told in text
    (failing,) = (one for one in summary["verdicts"] if one["verdict"] == "fails")
    lost, fitted = (
        "{:.2f} ({:.2f} to {:.2f})".format(*failing[name]) for name in ("total", "overfitting")
    )
    assert f"all of the loss of {lost} is overfitting: {fitted}" in text
    assert f"succeed there in {100 * rows['reference dt=0.05'][0]:.0f} %" in text
    assert f"policies succeed in {100 * rows[fine][0]:.0f} % on the truth" in text


def test_lines_of_the_readme_s_commands_fit_where_it_is_shown():
    lines = "\n".join(page_blocks("README.md", "sh")).splitlines()
    assert lines
    assert max(map(len, lines)) <= 88  # characters that GitHub shows of a line at 1440 px


def test_shell_lines_name_what_exists():
    lines = "\n".join(page_blocks("README.md", "sh")).replace("\\\n", "").splitlines()
    for line in filter(str.strip, lines):
        words = shlex.split(line.split("  #")[0])
        if words[0] == "make":
            assert f"\n{words[1]}:" in page_text("Makefile"), line
        elif words[0] == "integ-gym":
            assert words[1] in COMMANDS, line
            assert all((ROOT / word).exists() for word in words[2:] if word.endswith(".toml")), line
        elif words[0] == "python":
            assert (ROOT / words[1]).exists(), line
        else:
            assert words[:2] == ["pip", "install"], line
            extra = re.search(r"\[(\w+)\]", line)
            assert extra is None or f"\n{extra[1]} = [" in page_text("pyproject.toml"), line


def test_links_and_pictures_exist():
    for document in DOCUMENTS:
        text = document.read_text(encoding="utf-8")
        for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", text):
            made = target.endswith("fields.md")  # by docs/site/generated.py
            there = made or target.startswith("https://") or (document.parent / target).exists()
            assert there, f"{document}: {target}"
        assert "<!--" not in re.sub(r"<!-- \S+, table \d+ -->", "", text), document
