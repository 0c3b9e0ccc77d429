"""Pages of plants with several coordinates: recomputed as recorded, and drawn with their aims."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import report_example as example
from driving import Browser
from report_pages import panel_from, pixels

from integ_gym.envs.environment import environment_setup
from integ_gym.envs.ops.ops import SCALAR
from integ_gym.eval.report.episodes import read_episodes
from integ_gym.eval.report.page import render
from integ_gym.evidence.labels import EpisodeContext
from integ_gym.evidence.recorder import RecordEvidence
from integ_gym.evidence.store import EvidenceStore
from integ_gym.train.policy import BoxActions, DiscreteActions, MlpPolicy
from integ_gym.train.policy_files.writing import save_policy

pytestmark = pytest.mark.slow

NEAR = 1e-6
"""Of what is recomputed to what is recorded, in SI units."""

PERIOD, ROW = 0.02, "small.safetensors"
CELLS = [
    example.cell("rk4", 0.002, PERIOD),
    example.cell("implicit_midpoint", 0.01, PERIOD),
    example.cell("reference", PERIOD, PERIOD, kind="reference", role="reference"),
]
CASES: dict[str, dict[str, Any]] = {
    "IntegHopper-v0": {"duration": 1.0},
    "IntegReacher-v0": {"duration": 2.0},
    "IntegQuadrotor-v0": {"duration": 6.0, "way_point_period": 1.0},
    "IntegCartPoleSwingUp-v0": {"duration": 2.0},
    "IntegAcrobotSwingUp-v0": {"duration": 2.0},
    "IntegAcrobot-v0": {"duration": 2.0},
}
MADE = "const watch = watched && carried.leads.length ? new Watch(carried, watched) : null;"
RECOMPUTED = """carried.leads.flatMap((lead) => lead.cells.map((c) => {
  const own = carried.trace(lead.at[0], c, lead.at[2], lead.at[3]);
  const made = carried.live.trace(carried.trace(...lead.at), c, null);
  return { id: own.id, success: made.label === "none", totals: made.totals,
    motion: Object.fromEntries(Object.entries(made.motion).map(([name, x]) => [name, [...x]])) };
}))"""
SHOWN = """(() => {
  watch.player.show(%s);
  const [stage] = watch.player.parts.filter((part) => part.scene);
  const at = (one) => one.transform.baseVal[0].matrix;
  const { foot, aimed } = stage;
  return { q: stage.coordinates(%s), touches: foot && foot.classList.contains("touches"),
    foot: foot && [at(foot).e, -at(foot).f], aimed: aimed && [at(aimed).e, -at(aimed).f] };
})()"""


def small_policy(space: gym.Space[Any], actions: gym.Space[Any]) -> MlpPolicy:
    """A network of drawn weights; of a `Box` its actions are not far from the middle."""
    rng = np.random.default_rng(0)
    if isinstance(actions, gym.spaces.Discrete):
        count = int(actions.n)
        first, last = rng.normal(0.0, 1.0, (16, *space.shape)), rng.normal(0.0, 1.0, (count, 16))
        layers = (first, np.zeros(16)), (last, np.zeros(count))
        return MlpPolicy(layers, "Tanh", DiscreteActions(count))
    low, high = actions.low.astype(float), actions.high.astype(float)
    first, last = rng.normal(0.0, 0.2, (16, *space.shape)), rng.normal(0.0, 0.2, (len(low), 16))
    layers = ((first, np.zeros(16)), (0.1 * high[:, None] * last, 0.5 * (low + high)))
    return MlpPolicy(layers, "Tanh", BoxActions(low.tolist(), high.tolist()))


def make_page(env_id: str, directory: Path) -> Path:
    """A page of recorded episodes of such a policy, in three cells from the same starts."""
    arguments = CASES[env_id]
    raw = example.base_panel([example.row(ROW, "given", "rk4", 1)], CELLS, 1)
    raw["spec"] |= {"env_id": env_id, "environment": arguments, "control_period": PERIOD}
    told = raw["rows"][0]["policies"][0]
    policy = None
    for cell in CELLS:
        place = {name: cell[name] for name in ("integrator", "dt", "control_period")}
        env = gym.make(env_id, **arguments, **place)
        policy = policy or small_policy(env.observation_space, env.action_space)
        context = EpisodeContext("run", cell["name"], policy_id=told["id"])
        with RecordEvidence(env, directory / "evidence", context) as recorder:
            for seed in range(3):
                observation, _ = recorder.reset(seed=seed)
                ended = False
                while not ended:
                    observation, _, *ends, _ = recorder.step(policy.act(observation[None])[0])
                    ended = any(ends)
    save_policy(policy, directory / ROW, env_id, home=None)
    told |= {"hash": policy.content_hash, "file": ROW}
    panel = panel_from(raw)
    html = render(panel, read_episodes(panel, directory))
    assert MADE in html
    html = re.sub(r"<meta http-equiv[^>]*>", "", html)
    html = html.replace(MADE, f"{MADE} Object.assign(globalThis, {{ carried, watch }});")
    (directory / "page.html").write_text(html, "utf-8")
    return directory / "page.html"


@pytest.mark.parametrize("env_id", CASES)
def test_episodes_recomputed_are_the_recorded_ones(
    env_id: str, browser: Browser, tmp_path: Path
) -> None:
    browser.open_report(make_page(env_id, tmp_path).as_uri())
    episodes = browser.value(RECOMPUTED)
    store = EvidenceStore(tmp_path / "evidence")
    assert len({one["id"] for one in episodes}) >= 3
    for one in episodes:
        record = store.find(one["id"])
        assert len(one["motion"]) > 1
        for name, values in one["motion"].items():
            np.testing.assert_allclose(
                values, record.trace[name], rtol=0.0, atol=NEAR, err_msg=f"{record['cell']} {name}"
            )
        totals = [record["work_total"], record["energy_residual_total"]]
        np.testing.assert_allclose(one["totals"][:2], totals, rtol=1e-4, atol=1e-4)
        assert one["success"] == record["success"]
    assert browser.said == []


def test_a_hopper_meets_the_floor_where_its_plant_does(browser: Browser, tmp_path: Path) -> None:
    env_id, touches = "IntegHopper-v0", set()
    browser.open_report(make_page(env_id, tmp_path).as_uri())
    plant = environment_setup(env_id, {}).plant
    for time in np.arange(0.0, 0.5, 0.04):
        shown = browser.value(SHOWN % (time, time))
        gap = plant.foot(SCALAR, tuple(shown["q"])).gap
        assert shown["foot"][1] == pytest.approx(gap, abs=NEAR)
        assert shown["touches"] == (gap < 0.0)
        touches.add(shown["touches"])
    assert touches == {True, False}
    marks = "[...document.querySelectorAll('#watch-card .stage text')].map((x) => x.textContent)"
    assert {"0 m", "1 m"} <= set(browser.value(marks))
    look(browser, tmp_path)


@pytest.mark.parametrize("env_id", ["IntegReacher-v0", "IntegQuadrotor-v0"])
def test_what_moves_by_itself_is_shown_where_the_task_has_it(
    env_id: str, browser: Browser, tmp_path: Path
) -> None:
    browser.open_report(make_page(env_id, tmp_path).as_uri())
    setup, seen = environment_setup(env_id, CASES[env_id]), set()
    for time in np.arange(0.0, 1.4, 0.1):
        shown = browser.value(SHOWN % (time, time))
        *q, phase = shown["q"]
        rest = (0.0,) * (len(setup.plant.coordinates) - len(q) - 1)
        place = setup.task.target(SCALAR, (*q, *rest, phase))
        np.testing.assert_allclose(shown["aimed"], place, atol=NEAR)
        seen.add(tuple(np.round(place, 3)))
    assert len(seen) > 1
    look(browser, tmp_path)


def look(browser: Browser, folder: Path) -> None:
    """The page fits a phone, and something blue is drawn on it."""
    browser.size(390, 844, phone=True)
    assert browser.value("document.documentElement.scrollWidth <= innerWidth")
    browser.value("document.querySelector('#watch-card').scrollIntoView()")
    browser.picture(folder / "shot.png")
    image = pixels(folder / "shot.png")
    assert (image[..., 2] - image[..., 0] > 0.2).mean() > 0.001
    assert browser.said == []
