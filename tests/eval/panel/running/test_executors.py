"""One panel on every executor: equal records, whatever is killed in the middle."""

import os
import signal

import pytest
from ray.cluster_utils import Cluster
from shared_panel import (
    assert_equal_records,
    ended,
    kill_a_worker,
    kill_group,
    started,
    until,
    words,
)
from victim import Victim, make_victim

from integ_gym.cli import main

pytestmark = pytest.mark.slow

OWN = "shared_panel:two_processes"
SPAWNED = "spawn_main"
"""In the command line of a worker of this machine's, of Dask's or of an executor of one's own."""

RAY = "ray::_call_with"
JOB = "submitit.core._submit"


@pytest.mark.parametrize(
    ("executor", "worker"), [("local", SPAWNED), (OWN, SPAWNED), ("dask", SPAWNED), ("slurm", JOB)]
)
def test_records_are_the_same_with_a_worker_killed(
    tmp_path, undisturbed, monkeypatch, executor, worker
):
    """Jobs of Slurm run here, by submitit's executor for that."""
    monkeypatch.chdir(tmp_path)
    run, address = tmp_path / "run", ("--address", "local") if executor == "slurm" else ()
    driver = started(words(tmp_path, run, "--executor", executor, *address))
    kill_a_worker(driver.pid, worker, driver)
    assert ended(driver) == 0
    assert_equal_records(run, undisturbed)
    assert not list(tmp_path.glob(".*"))


@pytest.fixture
def two_nodes():
    """A cluster of Ray of two nodes with one core each, on this machine, and the second node."""
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    second = cluster.add_node(num_cpus=1)
    cluster.wait_for_nodes()
    yield cluster, second
    cluster.shutdown()


def test_ray_gives_the_same_records_with_a_node_and_a_worker_killed(
    tmp_path, undisturbed, two_nodes
):
    run, (cluster, second) = tmp_path / "run", two_nodes
    address = ("--executor", "ray", "--address", cluster.address)
    driver = started(words(tmp_path, run, *address))
    kill_a_worker(os.getpid(), RAY, driver)
    cluster.remove_node(second, allow_graceful=False)
    assert ended(driver) == 0
    assert_equal_records(run, undisturbed)


def test_a_killed_driver_is_followed_by_another_executors(tmp_path, undisturbed):
    """Dask's by this machine's; this machine's by one of one's own in `test_stored.py`."""
    run = tmp_path / "run"
    driver = started(words(tmp_path, run, "--executor", "dask"))
    until(lambda: list(run.glob("units/train-*.json")), driver)
    os.kill(driver.pid, signal.SIGKILL)
    driver.join()
    assert not (run / "panel.json").exists()
    assert main(["report", str(run)]) == 2, "it is not finished"
    kept = {file: file.stat().st_mtime_ns for file in run.glob("units/*.json")}
    again = started(words(tmp_path, run, "--executor", "local"))
    assert ended(again) == 0
    kill_group(driver)
    assert kept == {file: file.stat().st_mtime_ns for file in kept}
    assert_equal_records(run, undisturbed)


@pytest.fixture(scope="session")
def victim(made_once) -> Victim:
    """A finished panel of stable-baselines3's, and an evaluation of one of its policies."""
    return Victim(made_once("victim", make_victim))


@pytest.mark.parametrize("kind", ["panel", "evaluation"])
def test_stable_baselines3_and_an_evaluation_of_one_policy_too(victim, tmp_path, kind):
    run, task = tmp_path / "run", getattr(victim, kind)
    assert main([*task.given(run, 2), "--executor", OWN]) == 0
    assert_equal_records(run, task.done)
