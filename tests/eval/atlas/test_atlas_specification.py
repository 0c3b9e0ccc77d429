"""Blocks of an atlas, and what is refused."""

from __future__ import annotations

import pytest
from small_atlas import written

from integ_gym.envs.settings import Discretization
from integ_gym.eval.atlas.specification import (
    control_argument,
    critical_limit,
    middle_start,
    read_atlas,
    setup_of,
)
from integ_gym.eval.panel.cells import SpecError

RK4 = Discretization("rk4", 0.05, 0.05)


def test_blocks_are_every_ratio_with_the_first_seeds_then_with_the_next(tmp_path):
    atlas = read_atlas(written(tmp_path))
    blocks = atlas.blocks()
    assert [block.name for block in blocks] == ["1.5-seed3", "3-seed3", "1.5-seed4", "3-seed4"]
    assert [block.panel.seeds for block in blocks] == [(3,), (3,), (4,), (4,)]
    for block in blocks:
        assert block.limit == pytest.approx(block.ratio * atlas.critical, abs=5e-5)
        assert block.panel.environment["max_torque"] == block.limit
        assert block.panel.environment["duration"] == 3.0


def test_a_critical_limit_that_is_stated_is_taken(tmp_path):
    path = written(tmp_path, seeds_per_block="seeds_per_block = 1\ncritical = 0.25")
    assert [block.limit for block in read_atlas(path).blocks()[:2]] == [0.375, 0.75]


def test_the_critical_torque_lifts_and_less_does_not():
    """Of the rod within 10 s: 0.420 N m, on the truth and where the map is nearly exact."""
    given = {"start": "hanging", "duration": 10.0}
    truth = Discretization("reference", 0.05, 0.05)
    assert critical_limit("IntegPendulum-v0", given, "max_torque", truth) == pytest.approx(
        0.4202, abs=2e-4
    )
    pumping = Discretization("explicit_euler", 0.05, 0.05)
    assert critical_limit("IntegPendulum-v0", given, "max_torque", pumping) < 0.1


@pytest.mark.parametrize(
    ("env_id", "name", "start"),
    [
        ("IntegPendulum-v0", "max_torque", [3.141592653589793, 0.0]),
        ("IntegCartPoleSwingUp-v0", "max_force", [0.0, 0.0, 3.141592653589793, 0.0]),
    ],
)
def test_the_control_argument_and_the_middle_of_the_starts(env_id, name, start):
    setup = setup_of(env_id, {"start": "hanging"}, RK4)
    assert control_argument(setup) == (name, float(setup.task.control_limit))
    assert middle_start(setup).tolist() == start


@pytest.mark.parametrize(
    ("key", "line", "message"),
    [
        ("ratios", "ratios = [3.0, 1.5]", "`ratios` must be above 0 and ascend"),
        ("ratios", "ratios = []", "`ratios` must be above 0 and ascend"),
        ("argument", 'argumnt = "max_torque"', "required field `argument`|unknown field"),
        ("seeds_per_block", "seeds_per_block = 0", "`seeds_per_block` must be 1 or above"),
        ("argument", 'argument = "max_speed"', "`max_speed` does not limit the control"),
    ],
)
def test_what_cannot_be_is_refused_in_one_sentence(tmp_path, key, line, message):
    path = written(tmp_path, **{key: line})
    with pytest.raises(SpecError, match=message) as caught:
        read_atlas(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_panel_without_an_atlas_is_none(tmp_path):
    path = written(tmp_path)
    path.write_text(path.read_text().replace("[atlas]", "[other]"), encoding="utf-8")
    with pytest.raises(SpecError, match="has no table"):
        read_atlas(path)
