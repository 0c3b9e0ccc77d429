"""What the fleet trains together, on what, and within which memory."""

import time
from contextlib import suppress
from functools import partial
from threading import Thread

import psutil
import pytest
from fleet_runs import own_gpu, small_run, trained_memory

from integ_gym.envs.integrators.euler import ExplicitEuler
from integ_gym.support.executors import MOST_LOSSES
from integ_gym.support.processes import Progress
from integ_gym.train.config import TrainingError
from integ_gym.train.fleet import planning as fleet_plan
from integ_gym.train.fleet import worker as fleet_worker
from integ_gym.train.fleet.planning import PROGRAM_BYTES, default_gib, kind_of, plan
from integ_gym.train.fleet.training import train_fleet
from integ_gym.train.fleet.worker import Workers, fleet_workers, prepare_worker

ONE, TWO = Workers(1, "cpu"), Workers(2, "cpu")


def test_plan_groups_what_compiles_together():
    pendulum = [
        small_run(seed=s, env_arguments={"integrator": i})
        for i in ("rk4", "explicit_euler")
        for s in range(25)
    ]
    cart = [small_run("IntegCartPole-v0")]
    chunks = plan([*pendulum, *cart], TWO)
    assert sorted(p for c in chunks for p in c.places) == list(range(51))
    assert len({c.kind for c in chunks}) == 3
    assert sum(c.decisions for c in chunks) == 51 * 256
    assert len(plan(pendulum[:4], TWO)) == 2
    assert plan([], TWO) == []


def test_chunks_fit_the_memory():
    configs = [small_run(seed=seed, n_steps=1024) for seed in range(40)]
    held = kind_of(configs[0]).bytes
    for policies in (1, 3, 20):
        gib = 2 * (PROGRAM_BYTES + policies * held) / 2**30
        chunks = plan(configs, TWO, memory_gib=gib)
        assert max(len(chunk.places) for chunk in chunks) <= policies
        assert len(chunks) == max(2, -(-40 // policies))
    with pytest.raises(ValueError, match=r"does not hold one policy in each of 2 processes"):
        plan(configs, TWO, memory_gib=1.0)


class StepByStep(ExplicitEuler):
    """An integrator that looks at the state, as only the worlds of numbers allow."""

    def step(self, ops, system, q, v, losses, control, dt):
        half = 0.5 * dt if float(v[0]) > 5.0 else dt
        return super().step(ops, system, q, v, losses, control, half)


def test_what_the_fleet_cannot_train_is_refused_with_the_remedy():
    own = f"{__name__}:StepByStep"
    for arguments, fragment in (
        ({"engine": "mujoco", "integrator": "Euler"}, "engine 'mujoco', which is not made of"),
        ({"mixture": [{"engine": "drake", "integrator": "rk3"}]}, "engine 'drake'"),
        ({"contact": "engine"}, "`contact`='engine'"),
        ({"integrator": own}, f"cannot compile IntegPendulum-v0 with {own}"),
    ):
        with pytest.raises(ValueError, match=r"--trainer sb3") as caught:
            plan([small_run(env_arguments=arguments)], ONE)
        assert fragment in str(caught.value)
        assert "\n" not in str(caught.value)


@pytest.mark.slow
@pytest.mark.parametrize(
    "overrides",
    [
        {"trace_every": 1, "total_steps": 200_000, "n_steps": 256, "batch_size": 512},
        {"trace_every": 50, "n_steps": 2048, "batch_size": 2048, "n_epochs": 1},
    ],
)
def test_the_memory_that_is_planned_for_is_enough(overrides, tmp_path):
    configs = [small_run(seed=seed, **overrides) for seed in range(4)]
    planned = PROGRAM_BYTES + len(configs) * kind_of(configs[0]).bytes
    prepare = partial(prepare_worker, str(tmp_path / "cache"), "cpu")
    with Progress().pool(1, prepare) as pool:
        assert (
            PROGRAM_BYTES / 2 < pool.submit(trained_memory, configs, tmp_path).result() <= planned
        )


def test_the_budget_is_part_of_a_small_machine_s_memory(monkeypatch):
    machine = {"SC_PHYS_PAGES": 2**19, "SC_PAGE_SIZE": 2**12}
    monkeypatch.setattr(fleet_plan.os, "sysconf", machine.get)
    assert default_gib(ONE) == 1.5
    assert default_gib(Workers(16, "cpu")) == 1.5
    assert default_gib(Workers(2, "gpu")) == 16.0


def test_gpus_are_used_where_jax_has_any(monkeypatch):
    """Never by more processes than there are GPUs: another one would have none."""
    known = [*fleet_worker._CUDA_PLUGINS]
    monkeypatch.setattr(fleet_worker.importlib.util, "find_spec", lambda name: name in known)
    monkeypatch.delenv("JAX_PLATFORMS", raising=False)
    for listed, requested, expected in (
        ("0", None, Workers(1, "gpu")),
        ("0", 16, Workers(1, "gpu")),
        ("2,5", None, Workers(2, "gpu")),
        ("2,5", 1, Workers(1, "gpu")),
        ("-1", 3, Workers(3, "cpu")),
        ("", 3, Workers(3, "cpu")),
    ):
        monkeypatch.setenv("CUDA_VISIBLE_DEVICES", listed)
        assert fleet_workers(requested) == expected, listed
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "0")
    monkeypatch.setenv("JAX_PLATFORMS", "cpu")
    assert fleet_workers(3) == Workers(3, "cpu")
    monkeypatch.setenv("JAX_PLATFORMS", "cuda,cpu")
    assert fleet_workers() == Workers(1, "gpu")
    known.clear()
    assert fleet_workers(3) == Workers(3, "cpu")


def test_a_process_sees_a_gpu_of_its_own(monkeypatch, tmp_path):
    """In a fresh process, with the number that the pool gives it."""
    folder = tmp_path / fleet_worker._CUDA_PLUGINS[0]
    folder.mkdir()
    (folder / "__init__.py").touch()
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "3,7")
    monkeypatch.delenv("JAX_PLATFORMS", raising=False)
    prepare = partial(prepare_worker, str(tmp_path / "cache"), "gpu")
    with Progress().pool(1, prepare) as pool:
        assert pool.submit(own_gpu).result() == "3"


def _kill_workers():
    """Kill a worker process as often as one is lost before a run gives up."""
    killed = set()
    while len(killed) < MOST_LOSSES:
        for child in psutil.Process().children():
            with suppress(psutil.NoSuchProcess):
                if child.pid not in killed and "spawn_main" in " ".join(child.cmdline()):
                    killed.add(child.pid)
                    child.kill()
        time.sleep(0.05)


def test_workers_that_are_killed_again_and_again_are_one_sentence(tmp_path):
    killer = Thread(target=_kill_workers, daemon=True)
    killer.start()
    with pytest.raises(TrainingError, match=r"processes were killed.*memory_gib.*kept \(0\)"):
        train_fleet([small_run(total_steps=10_000_000)], [tmp_path / "a"], progress=False)
    killer.join()
