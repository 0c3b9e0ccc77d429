"""What a larger specification adds, and what contradicts, in words."""

from __future__ import annotations

from typing import Any

import pytest
from small_panel import small_data

from integ_gym.eval.panel.plan import additions, contradictions, with_episode_parts
from integ_gym.eval.panel.spec import parse_spec

SWEEP = {"argument": "action_latency", "values": [0.0, 0.05, 0.1]}
MIXED = {"mixture": "both", "members": [{"integrator": ["rk4", "explicit_euler"], "dt": 0.05}]}
STIFFER = {"name": "heavier", "environment": {"mass": 1.5, "damping": 0.1}}
SMALL = small_data()

LARGER = [
    ({"seeds": [0, 1, 2, 3]}, "seeds 2, 3"),
    ({"question": "And now?"}, "question"),
    ({"sweep": [SWEEP]}, "sweep of `action_latency` at 0, 0.05, 0.1"),
    ({"train": [*SMALL["train"], MIXED]}, "row 'both'"),
    ({"train": [*SMALL["train"], {"integrator": "rk4", "dt": 0.0125}]}, "row 'rk4 dt=0.0125'"),
    (
        {"perturbations": [*SMALL["perturbations"], STIFFER]},
        "perturbation 'heavier' (mass = 1.5, damping = 0.1)",
    ),
    (
        {"evaluate": [*SMALL["evaluate"], {"integrator": "rk4", "dt": 0.025}]},
        "cell 'rk4 dt=0.025'",
    ),
]


def _plain(**changes: Any) -> dict[str, Any]:
    return parse_spec(small_data(**changes), "small").to_json()


@pytest.mark.parametrize(("changes", "words"), LARGER)
def test_what_is_new_is_said_and_contradicts_nothing(changes, words):
    assert list(additions(_plain(), _plain(**changes))) == [words]
    assert list(contradictions(_plain(), _plain(**changes))) == []


@pytest.mark.parametrize(("changes", "words"), LARGER[2:])
def test_what_is_missing_is_said_and_is_nothing_new(changes, words):
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
    assert list(additions(one, more)) == ["sweep of `action_latency` at 0.05"]
    assert list(contradictions(more, one)) == [
        "it has sweep of `action_latency` at 0.05, which is missing now"
    ]


@pytest.mark.parametrize(
    ("held", "asked", "parts"),
    [
        (3, 3, ()),
        (3, 5, (3, 2)),
        ([3, 2], 5, (3, 2)),
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


@pytest.mark.parametrize("damaged", [None, "3", [3], 3.5, True])
def test_damaged_episodes_are_not_gone_on_with(damaged):
    before, spec = {**_plain(), "episodes": damaged}, parse_spec(SMALL, "small")
    there = with_episode_parts(spec, before)
    assert list(contradictions(before, there.to_json())) == ["`episodes` none (now 3)"]


def test_the_same_adds_nothing():
    assert list(additions(_plain(), _plain())) == list(contradictions(_plain(), _plain())) == []


@pytest.mark.parametrize("damaged", [[7], [{"name": "heavier"}], [{"environment": 3, "name": 0}]])
def test_what_a_damaged_manifest_holds_is_told_as_it_is(damaged):
    held = {**_plain(), "perturbations": damaged}
    (told,) = contradictions(held, _plain())
    assert told.startswith("it has perturbation ")
