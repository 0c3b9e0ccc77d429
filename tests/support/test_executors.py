"""Executors: what is refused, that tasks report and print, and that a lost worker is replaced."""

import subprocess
import sys
import time
from concurrent.futures import BrokenExecutor, ThreadPoolExecutor
from pathlib import Path

import pytest
import tasks
from tasks import always_die, die_once, fail, lose, number_of_prepared, report_and_print, touch

from integ_gym.support.executors import (
    AHEAD,
    MOST_LOSSES,
    Cluster,
    ClusterError,
    Resources,
    TaskPool,
    open_cluster,
)
from integ_gym.support.processes import Progress


class _Bar:
    """What a bar keeps."""

    def __init__(self):
        self.total, self.n = 6.0, 0.0

    def update(self, amount):
        self.n += amount


@pytest.mark.parametrize(
    ("executor", "address", "message"),
    [
        ("local", "ray://head:10001", "--address names a cluster of Ray or Dask"),
        ("cloud", None, "must be one of local, ray, dask, slurm"),
        ("no_module_of_that_name:made", None, "importable from here"),
        (f"{__name__}:absent", None, "cannot get an executor"),
        ("tasks:no_executor", None, "gives int, which is no executor"),
        ("slurm", "head:6379", "Slurm has no address"),
        ("slurm", None, "--workers N"),
    ],
)
def test_what_is_no_executor_is_refused_with_the_remedy(executor, address, message):
    with pytest.raises(ClusterError, match=message), open_cluster(executor, address):
        pass


def test_slurm_is_refused_where_there_is_none(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", str(tmp_path))
    refused = pytest.raises(ClusterError, match="no Slurm answers here")
    with refused, open_cluster("slurm", resources=Resources(2)):
        pass
    assert not list(tmp_path.iterdir())


LOGGED = """
import logging
from integ_gym.support.executors import Resources, open_cluster

class Closed(logging.StreamHandler):
    def close(self):
        print("closed", flush=True)
        super().close()

logging.getLogger("mine").addHandler(Closed())
with open_cluster("slurm", "local", Resources(1)):
    assert logging._handlerList
    print("open", flush=True)
"""


def test_submitit_leaves_the_handlers_of_the_process_alone(tmp_path):
    """Its own set-up of logging would close them, and with them streams that are still used."""
    words = [sys.executable, "-c", LOGGED]
    told = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    assert told.splitlines()[0] == "open"


def test_what_cannot_be_set_aside_is_refused():
    for wanted in ({"cores": 2}, {"gpus": 1.0}):
        resources = Resources(**wanted)
        refused = pytest.raises(ClusterError, match="give --workers")
        with refused, open_cluster("local", resources=resources):
            pass
    for wanted in ({"cores": 0}, {"gpus": -1.0}):
        with pytest.raises(ClusterError, match="or more"):
            Resources(**wanted)


def test_a_task_reports_and_prints_as_one_of_this_machine_does(capsys):
    _check_reports("tasks:one_thread", None, capsys)


def _check_reports(executor, address, capsys):
    bar = _Bar()
    with open_cluster(executor, address, Resources(2)) as cluster:
        assert cluster.workers == 2
        assert cluster.remote
        with TaskPool(cluster, Progress(bar), number_of_prepared) as pool:
            ended = dict(pool.run({n: (report_and_print, n) for n in (1, 2, 3)}))
            assert {n: future.result() for n, future in ended.items()} == {1: 1, 2: 4, 3: 9}
            ((_, failed),) = pool.run({0: (fail,)})
            assert isinstance(failed.exception(), ZeroDivisionError)
        assert bar.n == 6.0
    printed = capsys.readouterr().err
    assert [f"worked on {n}" in printed for n in (1, 2, 3)] == [True] * 3


def test_what_waits_is_cancelled_after_an_error():
    with open_cluster("tasks:one_thread", resources=Resources(1)) as cluster:
        futures = []

        def fail_with_much_to_do():
            with cluster.pool(Progress()) as pool:
                futures.extend(pool.submit(report_and_print, 1) for _ in range(200))
                fail()

        with pytest.raises(ZeroDivisionError):
            fail_with_much_to_do()
        assert any(future.cancelled() for future in futures)


OWN = "tasks:two_processes"
HELPERS = str(Path(tasks.__file__).parent)


@pytest.mark.parametrize("executor", ["local", OWN])
def test_the_task_of_a_worker_that_died_is_given_to_another(tmp_path, executor, capsys):
    discarded = []
    with open_cluster(executor, resources=Resources(2)) as cluster:
        tasks = {name: (die_once, str(tmp_path / name)) for name in ("a", "b", "c")}
        with TaskPool(cluster, Progress(_Bar())) as pool:
            ended = {name: f.result() for name, f in pool.run(tasks, discarded.append)}
    assert ended == dict.fromkeys(tasks, "done")
    assert set(discarded) == set(tasks)
    assert "is given to another" in capsys.readouterr().err


@pytest.mark.parametrize("workers", [0, 1, 2])
def test_no_more_is_given_out_than_the_workers_need(tmp_path, workers):
    """What tasks return would else wait here without a bound while each is written."""
    most = max(1, AHEAD * workers)
    tasks = {n: (touch, str(tmp_path / str(n))) for n in range(40)}
    with TaskPool(Cluster(workers), Progress(_Bar())) as pool:
        for taken, (n, future) in enumerate(pool.run(tasks), start=1):
            assert future.result() == str(tmp_path / str(n))
            time.sleep(0.02)
            assert len([*tmp_path.iterdir()]) < taken + most
    assert taken == len(tasks) == len([*tmp_path.iterdir()])


@pytest.mark.parametrize("executor", ["local", OWN])
def test_tasks_that_were_not_given_out_yet_outlive_a_lost_worker(tmp_path, executor, monkeypatch):
    monkeypatch.setattr("integ_gym.support.executors.AHEAD", 1)
    monkeypatch.setattr("integ_gym.support.executors.LEAST_AHEAD", 0)
    tasks = {n: (touch, str(tmp_path / str(n))) for n in range(30)}
    tasks |= {name: (die_once, str(tmp_path / name)) for name in ("a", "b")}
    tasks |= {n: (touch, str(tmp_path / str(n))) for n in range(30, 40)}
    with (
        open_cluster(executor, resources=Resources(2)) as cluster,
        TaskPool(cluster, Progress(_Bar())) as pool,
    ):
        ended = {key: future.result() for key, future in pool.run(tasks)}
    assert ended.keys() == tasks.keys()
    assert (ended["a"], ended["b"]) == ("done", "done")


def test_a_task_that_is_lost_alone_does_not_hold_up_the_others(tmp_path):
    """It is tried again once they are done, and ends the run."""
    tries, done, taken = tmp_path / "tries", tmp_path / "done", set()
    tasks = {-1: (lose, str(tries))} | {n: (touch, str(done)) for n in range(200)}
    with (
        open_cluster("tasks:one_thread") as cluster,
        TaskPool(cluster, Progress(_Bar())) as pool,
        pytest.raises(BrokenExecutor),
    ):
        taken.update(key for key, _ in pool.run(tasks))
    assert len(tries.read_text()) == MOST_LOSSES


class _Closing(ThreadPoolExecutor):
    """Takes three tasks, and none after them, as a cluster does that goes away."""

    room = 3

    def submit(self, *given, **named):
        if not self.room:
            raise RuntimeError("cannot schedule new futures after shutdown")
        self.room -= 1
        return super().submit(*given, **named)


@pytest.mark.parametrize("ahead", [1, 64])
def test_a_cluster_that_goes_away_between_two_tasks_is_connected_again(
    tmp_path, monkeypatch, ahead
):
    monkeypatch.setattr("integ_gym.support.executors.AHEAD", ahead)
    monkeypatch.setattr("integ_gym.support.executors.LEAST_AHEAD", 0)
    connected = []

    def connect():
        connected.append(_Closing(1))
        return connected[-1]

    tasks = {n: (touch, str(tmp_path / str(n))) for n in range(8)}
    with TaskPool(Cluster(1, connect=connect), Progress(_Bar())) as pool:
        ended = dict(pool.run(tasks))
    assert ended.keys() == tasks.keys()
    assert len(connected) == 3
    for executor in connected:
        executor.shutdown()


def test_a_task_that_kills_every_worker_ends_the_run():
    with (
        TaskPool(Cluster(1), Progress(_Bar())) as pool,
        pytest.raises(BrokenExecutor),
    ):
        dict(pool.run({"a": (always_die,)}))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("executor", "address"), [("dask", None), ("ray", None), ("slurm", "local"), (OWN, None)]
)
def test_executors_of_others_run_tasks(executor, address, capsys, tmp_path, monkeypatch):
    if executor == "slurm":
        monkeypatch.chdir(tmp_path)
        monkeypatch.setenv("PYTHONPATH", HELPERS)
    _check_reports(executor, address, capsys)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.parametrize(("executor", "address"), [("dask", "tcp://127.0.0.1:9")])
def test_a_cluster_that_does_not_answer_is_named(executor, address, monkeypatch):
    monkeypatch.setenv("DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT", "1s")
    with pytest.raises(ClusterError, match="no scheduler of Dask answers"):
        open_cluster(executor, address).__enter__()
