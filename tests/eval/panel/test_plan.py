"""How a panel may grow: what a larger plan adds, what contradicts, its parts, stages and sweeps."""

from __future__ import annotations

import json
from typing import Any

import pytest
from small_panel import small_data
from swaying import MONOPED

from integ_gym.envs.testbeds.making import find_testbed
from integ_gym.eval.panel.cells import SpecError
from integ_gym.eval.panel.costs import trying_seconds
from integ_gym.eval.panel.plan import (
    MOST_SEEDS,
    STAGES,
    additions,
    contradictions,
    inputs,
    read_planned_spec,
    stages,
    with_episode_parts,
    with_seed_count,
)
from integ_gym.eval.panel.spec import PanelSpec, parse_spec

SWEEP = {"argument": "action_latency", "values": [0.0, 0.05, 0.1]}
MIXED = {"mixture": "both", "members": [{"integrator": ["rk4", "explicit_euler"], "dt": 0.05}]}
STIFFER = {"name": "heavier", "environment": {"mass": 1.5, "damping": 0.1}}
SMALL = small_data()

LARGER = [
    ({"seeds": [0, 1, 2, 3]}, "seeds 2, 3"),
    ({"question": "And now?"}, "question"),
    (
        {"evaluate": [*SMALL["evaluate"], {"at": "truth", "mass": 2.0}]},
        "variation 'mass=2' (mass=2)",
    ),
    ({"train": [*SMALL["train"], MIXED]}, "row 'both'"),
    ({"train": [*SMALL["train"], {"integrator": "rk4", "dt": 0.0125}]}, "row 'rk4 dt=0.0125'"),
    (
        {"perturbations": [*SMALL["perturbations"], STIFFER]},
        "variation 'heavier' (mass=1.5, damping=0.1)",
    ),
    (
        {"evaluate": [*SMALL["evaluate"], {"integrator": "rk4", "dt": 0.025}]},
        "cell 'rk4 dt=0.025'",
    ),
]


def _plain(**changes: Any) -> dict[str, Any]:
    return parse_spec(small_data(**changes), "small").to_json()


@pytest.mark.parametrize(("changes", "words"), LARGER)
def test_what_is_new_is_said_and_contradicts_nothing_unless_it_is_missing(changes, words):
    assert list(additions(_plain(), _plain(**changes))) == [words]
    assert list(contradictions(_plain(), _plain(**changes))) == []
    if words[:5] not in ("seeds", "quest"):
        assert list(contradictions(_plain(**changes), _plain())) == [
            f"it has {words}, which is missing now"
        ]
        assert list(additions(_plain(**changes), _plain())) == []


@pytest.mark.parametrize(("one", "other"), [([], [42]), ([42], []), ([42], [42, 64])])
def test_planned_looks_stay_as_they_were_declared(one, other):
    plans = [_plain(**({"looks": looks} if looks else {})) for looks in (one, other)]
    assert list(contradictions(*plans)) == ["another `looks`"]


def test_of_a_sweep_the_values_are_told():
    one, more = (_plain(sweep=[{**SWEEP, "values": v}]) for v in ([0.0, 0.1], [0.0, 0.05, 0.1]))
    told = "variation 'action_latency=0.05' (action_latency=0.05)"
    assert list(additions(one, more)) == [told]
    assert list(contradictions(more, one)) == [f"it has {told}, which is missing now"]


@pytest.mark.parametrize(
    ("held", "asked", "parts"),
    [
        (3, 3, ()),
        (3, 5, (3, 2)),
        ([3, 2], 9, (3, 2, 4)),
        (3, [3, 2], (3, 2)),
        ([3, 2], [3, 2, 4], (3, 2, 4)),
    ],
)
def test_more_episodes_are_a_part_of_their_own(held, asked, parts):
    before, spec = _plain(episodes=held), parse_spec(small_data(episodes=asked), "small")
    there = with_episode_parts(spec, before)
    assert (there.episodes, there.episode_parts) == (spec.episodes, parts)
    more = there.episodes - before["episodes"]
    told = [f"{more} more episodes a seed"] if more else []
    assert list(additions(before, there.to_json())) == told
    assert list(contradictions(before, there.to_json())) == []


@pytest.mark.parametrize(
    ("held", "asked", "told"),
    [
        (3, 2, "`episodes` 3 (now 2)"),
        ([3, 2], 4, "`episodes` 3 + 2 (now 4)"),
        ([3, 2], [2, 3], "`episodes` 3 + 2 (now 2 + 3)"),
        (5, [3, 2], "`episodes` 5 (now 3 + 2)"),
    ],
)
def test_fewer_episodes_or_other_parts_contradict(held, asked, told):
    before, spec = _plain(episodes=held), parse_spec(small_data(episodes=asked), "small")
    assert list(contradictions(before, with_episode_parts(spec, before).to_json())) == [told]


@pytest.mark.parametrize("count", [1, 3])
def test_more_seeds_follow_those_that_are_there(count):
    spec = parse_spec(small_data(seeds=[7, 3]), "small")
    seeds = with_seed_count(spec, count).seeds
    assert len(seeds) == len(set(seeds)) == count
    assert seeds[:2] == (7, 3)[:count]
    assert list(seeds[2:]) == list(range(8, 8 + count - 2))


@pytest.mark.parametrize("count", [0, MOST_SEEDS + 1])
def test_numbers_of_seeds_that_cannot_be(count):
    with pytest.raises(SpecError, match="takes 1 to 10000 seeds, got"):
        with_seed_count(parse_spec(small_data(), "small"), count)


def test_records_do_not_depend_on_how_many_seeds_there_are():
    spec = parse_spec(small_data(), "small")
    cells = spec.cells_of(spec.train[0])
    own = inputs(spec, cells)
    assert (
        own == inputs(with_seed_count(spec, 40), cells) == inputs(with_seed_count(spec, 1), cells)
    )
    assert own == inputs(parse_spec(small_data(perturbations=[], question="?"), "small"), cells)
    assert own != inputs(spec, cells[1:])
    assert own != inputs(parse_spec(small_data(episodes=4), "small"), cells)
    assert own != inputs(parse_spec(small_data(seeds=[1, 2]), "small"), cells)


def test_parts_of_the_episodes_are_the_panel_as_it_was_with_each():
    whole = parse_spec(small_data(episodes=[3, 2, 4]), "small")
    first, second, last = whole.parts()
    assert [list(part.latest) for part in whole.parts()] == [[0, 1, 2], [3, 4], [5, 6, 7, 8]]
    assert last is whole
    assert (whole.episodes, whole.episode_parts) == (9, (3, 2, 4))
    assert second.to_json() == parse_spec(small_data(episodes=[3, 2]), "small").to_json()
    once = parse_spec(small_data(), "small")
    assert first.to_json() == once.to_json()
    assert "episode_parts" not in once.to_json()
    assert once.parts() == (once,)
    assert read_planned_spec(json.loads(json.dumps(whole.to_json()))).to_json() == whole.to_json()
    with pytest.raises(SpecError, match="`episode_parts` do not add up"):
        read_planned_spec({**whole.to_json(), "episodes": 8})


@pytest.mark.parametrize("episodes", [[3, 0], []])
def test_parts_without_episodes_are_refused(episodes):
    with pytest.raises(SpecError, match=">= 1 - at `episodes"):
        parse_spec(small_data(episodes=episodes), "small")


@pytest.mark.parametrize("count", [1, 5, 40, 41, 200])
def test_stages_are_the_first_seeds_and_end_with_all(count):
    spec = with_seed_count(parse_spec(small_data(), "small"), count)
    found = stages(spec)
    counts = [len(stage.seeds) for stage in found]
    assert found[-1] is spec
    assert counts == sorted(set(counts))
    assert set(counts[:-1]) <= set(STAGES)
    assert all(stage.seeds == spec.seeds[: len(stage.seeds)] for stage in found)
    assert all(2 * before < count for before in counts[:-1])


LATENCY = {"argument": "action_latency", "values": [0.1, 0.0, 0.05]}


def _swept(*sweeps, **changes):
    return parse_spec(small_data(sweep=list(sweeps), perturbations=[], **changes), "test")


def test_values_are_changes_and_the_undisturbed_one_is_there_already():
    spec = _swept(LATENCY, {"argument": "mass", "values": [0.8, 1.2]})
    names = ["action_latency=0.05", "action_latency=0.1", "mass=0.8", "mass=1.2"]
    cells = [cell.name for cell in spec.cells_of(spec.train[0]) if cell.kind == "varied"]
    assert cells == [
        f"{place} dt=0.05, {name}" for name in names for place in ("explicit_euler", "reference")
    ]
    assert "No action latency is evaluated." not in spec.gaps()


@pytest.mark.parametrize(
    ("sweep", "message"),
    [
        ({"argument": "dt", "values": [0.1, 0.2]}, "no cell"),
        ({"argument": "masss", "values": [1, 2]}, "Did you mean 'mass'"),
        ({"argument": "fallback", "values": [1, 2]}, "fallback"),
        ({"argument": "mass", "values": [1.0, "2"]}, "sweep.0..values"),
        ({"argument": "mass", "value": [1.0, 2.0]}, "unknown field `value` - at `sweep"),
    ],
)
def test_what_cannot_be_swept_is_refused(sweep, message):
    with pytest.raises(SpecError, match=message):
        _swept(sweep)


def test_of_another_librarys_environment_what_is_stated_is_swept():
    own = {
        "env_id": "Pendulum-v1", "family": [], "compare": [], "baselines": ["random"],
        "train": [{"integrator": "symplectic_euler", "dt": 0.05}],
        "evaluate": [{"integrator": "symplectic_euler", "dt": 0.05}],
    }  # fmt: skip
    gravity = {"argument": "g", "values": [8.0, 10.0]}
    for stated, varied in ({}, [8.0, 10.0]), ({"g": 10.0}, [8.0]):
        spec = _swept(gravity, environment=stated, **own)
        cells = spec.cells_of(spec.train[0])
        assert [cell.environment["g"] for cell in cells if cell.environment] == varied


def test_what_is_swept_twice_is_swept_once():
    assert _swept(LATENCY, LATENCY).to_json() == _swept(LATENCY).to_json()


def test_cells_that_no_controller_tries_cost_no_time():
    pendulum, home = parse_spec(small_data(), "small"), find_testbed(MONOPED, {}).home
    monoped = PanelSpec(
        name="robot", env_id=MONOPED, environment={}, control_period=0.02, train=(), grid=(home,),
        seeds=(), episodes=2, ladder=False,
    )  # fmt: skip
    assert [trying_seconds(own, own.columns()[0]) > 0.0 for own in (pendulum, monoped)] == [
        True, False,
    ]  # fmt: skip
