"""The fleet's processes: how many, on cores or GPUs, and how one is prepared; without JAX."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import platform
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Literal

from integ_gym.support.executors import Cluster
from integ_gym.support.processes import cores

Device = Literal["cpu", "gpu"]


GIB_PER_WORKER: dict[Device, float] = {"cpu": 1.5, "gpu": 8.0}
"""Budget of memory unless another is given."""


_CPU_FLAGS = ("--xla_cpu_multi_thread_eigen=false", "--xla_backend_optimization_level=1")
"""One thread; and a compiler that takes half the time for code that is as fast here."""


_CUDA_PLUGINS = ("jax_cuda12_plugin", "jax_cuda13_plugin")


@dataclass(frozen=True)
class Workers:
    """The fleet's processes.

    Attributes:
        count: how many; each has one core, or one GPU.
        device: on which of them they compute.
    """

    count: int
    device: Device


def fleet_workers(requested: int | None = None) -> Workers:
    """One process per GPU where JAX can use any, else one per core; at most as many as requested.

    Args:
        requested: processes; on a CPU there may be more of them than cores.
    """
    gpus = len(_gpus())
    if gpus:
        return Workers(min(requested or gpus, gpus), "gpu")
    return Workers(requested or cores(), "cpu")


def workers_of(cluster: Cluster) -> Workers:
    """Where the fleet trains; on GPUs of other machines where these were asked for."""
    if not cluster.remote:
        return fleet_workers(cluster.workers)
    return Workers(cluster.workers, "gpu" if cluster.gpus else "cpu")


def prepare_worker(cache_dir: str | None, device: Device, number: int) -> None:
    """Set up JAX in a worker process: one core or one GPU, and a cache of compiled programs.

    Args:
        cache_dir: of compiled programs; None: the user's cache folder on the worker's machine.
        device: what it computes on.
        number: of the process, which has the GPU of that number.
    """
    from integ_gym.envs.ops.jax_ops import jax

    if device == "gpu":
        os.environ["CUDA_VISIBLE_DEVICES"] = _gpus()[number]
    else:
        os.environ["JAX_PLATFORMS"] = "cpu"
        os.environ["NPROC"] = "1"
        os.environ["XLA_FLAGS"] = " ".join((os.environ.get("XLA_FLAGS", ""), *_CPU_FLAGS))
        jax.config.update("jax_platforms", "cpu")  # type: ignore[no-untyped-call]
    folder = cache_dir or str(default_cache_dir())
    jax.config.update("jax_compilation_cache_dir", folder)  # type: ignore[no-untyped-call]
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)  # type: ignore[no-untyped-call]


def default_cache_dir() -> Path:
    """Compiled programs of this machine's kind of processor."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    flags = next((line for line in lines if line.startswith(("flags", "Features"))), "")
    kind = hashlib.sha256(f"{platform.machine()} {flags}".encode()).hexdigest()[:12]
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "integ-gym" / f"jax-{kind}"


def _gpus() -> list[str]:
    """GPUs that JAX can use, by what `CUDA_VISIBLE_DEVICES` calls them; JAX is not started."""
    platforms = os.environ.get("JAX_PLATFORMS", "")
    if platforms and not {"cuda", "gpu"} & set(platforms.split(",")):
        return []
    if not any(importlib.util.find_spec(name) for name in _CUDA_PLUGINS):
        return []
    listed = os.environ.get("CUDA_VISIBLE_DEVICES")
    if listed is None:
        found = list(Path("/proc/driver/nvidia/gpus").glob("*"))
        return [str(number) for number in range(len(found))]
    names = (name.strip() for name in listed.split(","))
    return list(takewhile(lambda name: name and not name.startswith("-"), names))
