"""Panels that grow by seeds, and the stages in which they are shown."""

from __future__ import annotations

import json

import pytest
from small_panel import small_data

from integ_gym.eval.panel.cells import SpecError
from integ_gym.eval.panel.plan import (
    MOST_SEEDS,
    STAGES,
    inputs,
    planned_spec,
    stages,
    with_seed_count,
)
from integ_gym.eval.panel.spec import parse_spec


@pytest.mark.parametrize("count", [1, 2, 3, 60])
def test_more_seeds_follow_those_that_are_there(count):
    spec = parse_spec(small_data(seeds=[7, 3]), "small")
    seeds = with_seed_count(spec, count).seeds
    assert len(seeds) == len(set(seeds)) == count
    assert seeds[:2] == (7, 3)[:count]
    assert list(seeds[2:]) == list(range(8, 8 + count - 2))


@pytest.mark.parametrize("count", [0, -1, MOST_SEEDS + 1])
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
    assert planned_spec(json.loads(json.dumps(whole.to_json()))).to_json() == whole.to_json()
    with pytest.raises(SpecError, match="`episode_parts` do not add up"):
        planned_spec({**whole.to_json(), "episodes": 8})


@pytest.mark.parametrize("episodes", [0, [3, 0], []])
def test_parts_without_episodes_are_refused(episodes):
    with pytest.raises(SpecError, match="`episodes` must be 1 or above, or a list of such parts"):
        parse_spec(small_data(episodes=episodes), "small")


@pytest.mark.parametrize("count", [1, 5, 10, 11, 40, 41, 200])
def test_stages_are_the_first_seeds_and_end_with_all(count):
    spec = with_seed_count(parse_spec(small_data(), "small"), count)
    found = stages(spec)
    counts = [len(stage.seeds) for stage in found]
    assert found[-1] is spec
    assert counts == sorted(set(counts))
    assert set(counts[:-1]) <= set(STAGES)
    assert all(stage.seeds == spec.seeds[: len(stage.seeds)] for stage in found)
    assert all(2 * before < count for before in counts[:-1])
