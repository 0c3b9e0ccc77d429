"""Pages of robots: the skeleton is drawn where the model has it, and what is commanded is told."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest
from driving import Browser, assert_fits
from engine_cases import needs
from house import ROOT
from report_pages import MOST_BYTES, MOST_NODES, pixels
from swaying import MONOPED

import integ_gym
from integ_gym.envs.rendering.skeletons import Skeleton
from integ_gym.envs.testbeds.making import find_testbed
from integ_gym.eval.film import skeleton_of
from integ_gym.eval.panel.result import read_panel
from integ_gym.eval.report.matrices import command_matrix
from integ_gym.eval.watch import watch
from integ_gym.evidence.store import EvidenceStore
from integ_gym.support.errors import InputError
from integ_gym.support.terminal import compact

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    needs("mujoco")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT))
        directory = tmp_path_factory.mktemp("robot")
        integ_gym.evaluate(
            ROOT / "examples" / "robots" / "monoped_policy" / "policy.safetensors",
            MONOPED, directory, integrators=["Euler", "implicitfast"], dts=[0.004], episodes=2,
            environment={"duration": 2.0}, limit=False, workers=1, progress=False,
            on_doubt=lambda doubt: None,
        )  # fmt: skip
    return directory / "report.html"


MADE = "const watch = watched && carried.leads.length ? new Watch(carried, watched) : null;"
POSE = """(() => {
  const { carried, trace, ...robot } = watch.player.parts.find((part) => part.canvas);
  const { places, spins } = watch.player.parts.find((part) => part.canvas).pose(1.0);
  return { places, spins, q: robot.coordinates.map((n) => carried.at(trace, "motion", n, 1.0)) };
})()"""


def test_a_robot_is_drawn_where_its_model_has_it(
    report: Path, browser: Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import mujoco

    monkeypatch.syspath_prepend(str(ROOT))
    html = report.read_text("utf-8")
    assert MADE in html
    html = re.sub(r"<meta http-equiv[^>]*>", "", html)
    html = html.replace(MADE, f"{MADE} globalThis.watch = watch;")
    (tmp_path / "shown.html").write_text(html, "utf-8")
    browser.open_report((tmp_path / "shown.html").as_uri())
    found = browser.value(POSE)
    model = find_testbed(MONOPED, {}).compiled.model
    data = mujoco.MjData(model)
    data.qpos[:] = found["q"]
    mujoco.mj_kinematics(model, data)
    np.testing.assert_allclose(found["places"], data.xpos[1:], atol=1e-3)
    np.testing.assert_allclose(np.abs(found["spins"]), np.abs(data.xquat[1:]), atol=1e-3)
    browser.value("document.querySelector('#watch-card').scrollIntoView()")
    browser.picture(tmp_path / "shot.png")
    image = pixels(tmp_path / "shot.png")
    blue = (image[..., 2] - image[..., 0] > 0.2).mean()
    assert blue > 0.005
    assert browser.value("document.querySelector('.pane .bars').textContent").startswith("v x")
    assert browser.said == []


def test_its_page_is_light_and_fits_a_desktop_and_a_phone(
    report: Path, browser: Browser, tmp_path: Path
) -> None:
    html = report.read_text("utf-8")
    assert len(html.encode()) <= MOST_BYTES
    browser.open_report(report.as_uri())
    assert browser.value("document.querySelectorAll('*').length") <= MOST_NODES
    assert_fits(tmp_path, {"robot": html})


def test_its_film_is_drawn_from_the_record_alone(
    report: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import mujoco

    store = EvidenceStore(report.parent / "evidence")
    record = next(one for _, one in store.named_records() if one["policy_id"].startswith("ppo"))
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "examples.robots.monoped", None)  # none of its code is loaded
        film = watch(report.parent, record["record_id"], ["Euler", "implicitfast"])
        with pytest.raises(InputError, match="truth"):
            watch(report.parent, record["record_id"], ["truth"])
        with pytest.raises(InputError, match="implicitfast"):
            watch(report.parent, record["record_id"], ["RK4"])
    assert list(film.success) == ["mujoco Euler dt=0.004", "mujoco implicitfast dt=0.004"]
    first, later = film[0].astype(int), film[15].astype(int)
    for frame in (first, later):
        assert 0.005 < (frame[..., 2] - frame[..., 0] > 50).mean() < 0.5
    assert (first != later).mean() > 0.01
    monkeypatch.syspath_prepend(str(ROOT))
    model = find_testbed(MONOPED, {}).compiled.model
    data = mujoco.MjData(model)
    described = skeleton_of(record)
    assert described is not None
    for q in np.stack([record.trace[name] for name in described["coordinates"]], axis=1)[::20]:
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        places, turns = Skeleton(described, q).pose(q)
        np.testing.assert_allclose(places, data.xpos[1:], atol=1e-3)
        np.testing.assert_allclose(turns.reshape(-1, 9), data.xmat[1:], atol=1e-3)


def test_its_matrix_tells_by_how_much_commands_are_missed_and_who_falls(report: Path) -> None:
    matrix = command_matrix(read_panel(report.parent / "panel.json"))
    assert matrix is not None
    lines = {line.row.name: line.shades for block in matrix.blocks for line in block.lines}
    rows = EvidenceStore(report.parent / "evidence").query(
        "SELECT policy_id AS row, cell, avg(command_error) AS error, sum(terminated::INT) AS fell "
        "FROM records GROUP BY ALL"
    )
    assert {row["fell"] for row in rows.to_pylist()} > {0}
    for row in rows.to_pylist():
        shade = lines[row["row"]][row["cell"]]
        assert shade is not None
        assert shade.text == compact(row["error"], 3)
        assert shade.marks == ((f"↓{row['fell']}",) if row["fell"] else ())
