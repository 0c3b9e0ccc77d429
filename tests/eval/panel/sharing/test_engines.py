"""One panel on every engine: equal records, whatever is killed in the middle."""

from __future__ import annotations

import contextlib
import os
import signal

import pytest
from ray.cluster_utils import Cluster
from shared_panel import (
    assert_equal_records,
    ended,
    holders,
    kill_group,
    started,
    until,
    words,
)

OWN = "shared_panel:two_processes"


@pytest.fixture
def two_nodes():
    """A cluster of Ray of two nodes with one core each, on this machine, and the second node."""
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    second = cluster.add_node(num_cpus=1)
    cluster.wait_for_nodes()
    yield cluster, second
    cluster.shutdown()


def _kill_a_holder(run, process):
    """Kill a process of an engine's that trains; what it held is done again."""

    def killed():
        for unit, pid in holders(run, "driven").items():
            with contextlib.suppress(ProcessLookupError):  # with its node
                os.kill(pid, signal.SIGKILL)
                return unit
        return None

    return until(killed, process)


def _taken_over(run, unit):
    return list((run / ".work" / "driven" / "claims").rglob(f"{unit}.2"))


@pytest.mark.slow
def test_an_executor_of_ones_own_gives_the_same_records(tmp_path, undisturbed):
    run = tmp_path / "run"
    assert ended(started(words(tmp_path, run, "--executor", OWN))) == 0
    assert_equal_records(run, undisturbed)


@pytest.mark.slow
def test_dask_gives_the_same_records_with_a_worker_killed(tmp_path, undisturbed):
    run = tmp_path / "run"
    process = started(words(tmp_path, run, "--executor", "dask"))
    unit = _kill_a_holder(run, process)
    until(lambda: _taken_over(run, unit), process)
    assert ended(process) == 0
    assert_equal_records(run, undisturbed)


@pytest.mark.slow
def test_ray_gives_the_same_records_with_a_node_and_a_worker_killed(
    tmp_path, undisturbed, two_nodes
):
    run, (cluster, second) = tmp_path / "run", two_nodes
    address = ("--executor", "ray", "--address", cluster.address)
    process = started(words(tmp_path, run, *address))
    until(lambda: len(holders(run, "driven")) == 2, process)
    cluster.remove_node(second, allow_graceful=False)
    _kill_a_holder(run, process)
    assert ended(process) == 0
    assert_equal_records(run, undisturbed)


@pytest.mark.slow
def test_two_nodes_of_ray_give_the_same_records(tmp_path, undisturbed, two_nodes):
    run, (cluster, _) = tmp_path / "run", two_nodes
    address = ("--executor", "ray", "--address", cluster.address)
    assert ended(started(words(tmp_path, run, *address))) == 0
    assert_equal_records(run, undisturbed)


@pytest.mark.slow
@pytest.mark.parametrize(("first", "second"), [("dask", "local"), ("local", OWN)])
def test_a_killed_driver_is_followed_by_another_engines(tmp_path, undisturbed, first, second):
    run = tmp_path / "run"
    process = started(words(tmp_path, run, "--executor", first))
    until(lambda: list(run.glob("units/train-*.json")), process)
    os.kill(process.pid, signal.SIGKILL)
    process.join()
    assert not (run / "panel.json").exists()
    kept = {file: file.stat().st_mtime_ns for file in run.glob("units/*.json")}
    again = started(words(tmp_path, run, "--executor", second))
    assert ended(again) == 0
    kill_group(process)
    assert kept == {file: file.stat().st_mtime_ns for file in kept}
    assert_equal_records(run, undisturbed)
