"""The fleet on another executor: the same policies, written where they are asked for."""

from __future__ import annotations

import pytest
from fleet_runs import small_run

from integ_gym.support.executors import ClusterError
from integ_gym.train.fleet.training import train_fleet


@pytest.mark.slow
def test_an_executor_of_ones_own_trains_the_same_policies(tmp_path):
    runs = [small_run(seed=seed) for seed in range(3)]
    told, here, there = {}, tmp_path / "here", tmp_path / "there"
    named = {"progress": False, "workers": 2}
    local = train_fleet(runs, [here / str(n) for n in range(3)], **named)
    folders = [there / str(n) for n in range(3)]
    own = train_fleet(
        runs, folders, executor="shared_panel:two_processes", on_trained=told.__setitem__, **named
    )
    assert [one.content_hash for one in own] == [one.content_hash for one in local]
    assert [one.policy.parent for one in own] == folders
    assert sorted(told) == [0, 1, 2]


def test_what_is_no_engine_is_refused_before_anything_is_written(tmp_path):
    with pytest.raises(ClusterError, match="must be one of local, ray, dask"):
        train_fleet([small_run()], [tmp_path / "out"], executor="cloud")
    assert not list(tmp_path.iterdir())
