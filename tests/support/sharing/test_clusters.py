"""Engines: what is refused, and that tasks report and print as those of this machine do."""

from __future__ import annotations

import pytest
from tasks import fail, number_of_prepared, report_and_print

from integ_gym.support.processes.workers import Progress
from integ_gym.support.sharing.clusters import cluster_of
from integ_gym.support.sharing.resources import ClusterError, Resources


class _Bar:
    """What a bar keeps."""

    def __init__(self):
        self.total, self.n = 6.0, 0.0

    def update(self, amount):
        self.n += amount


@pytest.mark.parametrize(
    ("executor", "address", "told"),
    [
        ("local", "ray://head:10001", "--address names a cluster of Ray or Dask"),
        ("slurm", None, "must be one of local, ray, dask"),
        ("no_module_of_that_name:made", None, "importable from here"),
        (f"{__name__}:absent", None, "cannot get an executor"),
        ("tasks:no_executor", None, "gives int, which is no executor"),
    ],
)
def test_what_is_no_engine_is_refused_with_the_remedy(executor, address, told):
    with pytest.raises(ClusterError, match=told), cluster_of(executor, address):
        pass


@pytest.mark.parametrize("wanted", [{"cores": 2}, {"gpus": 1.0}])
def test_this_machine_sets_nothing_aside(wanted):
    with (
        pytest.raises(ClusterError, match="give --workers"),
        cluster_of("local", resources=Resources(**wanted)),
    ):
        pass


@pytest.mark.parametrize("wanted", [{"cores": 0}, {"gpus": -1.0}])
def test_what_no_worker_has_is_refused(wanted):
    with pytest.raises(ClusterError, match="or more"):
        Resources(**wanted)


def test_a_task_reports_and_prints_as_one_of_this_machine_does(capsys):
    _check_reports("tasks:one_thread", capsys)


def _check_reports(executor, capsys):
    bar = _Bar()
    with cluster_of(executor, resources=Resources(2)) as cluster:
        assert cluster.workers == 2
        assert cluster.remote
        progress = Progress(bar)
        with cluster.pool(progress, number_of_prepared) as pool:
            futures = [pool.submit(report_and_print, n) for n in (1, 2, 3)]
            assert {future.result() for future in progress.ended(futures)} == {1, 4, 9}
            with pytest.raises(ZeroDivisionError):
                pool.submit(fail).result()
        assert bar.n == 6.0
    printed = capsys.readouterr().err
    assert [f"worked on {n}" in printed for n in (1, 2, 3)] == [True] * 3


def test_what_waits_is_cancelled_after_an_error():
    with cluster_of("tasks:one_thread", resources=Resources(1)) as cluster:
        futures = []

        def fail_with_much_to_do():
            with cluster.pool(Progress()) as pool:
                futures.extend(pool.submit(report_and_print, 1) for _ in range(200))
                fail()

        with pytest.raises(ZeroDivisionError):
            fail_with_much_to_do()
        assert any(future.cancelled() for future in futures)


@pytest.mark.slow
@pytest.mark.parametrize("executor", ["dask", "ray", "shared_panel:two_processes"])
def test_an_engine_of_others_runs_tasks(executor, capsys):
    _check_reports(executor, capsys)


@pytest.mark.slow
@pytest.mark.parametrize(("executor", "address"), [("dask", "tcp://127.0.0.1:9")])
def test_a_cluster_that_does_not_answer_is_named(executor, address, monkeypatch):
    monkeypatch.setenv("DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT", "1s")
    with pytest.raises(ClusterError, match="no scheduler of Dask answers"):
        cluster_of(executor, address).__enter__()
