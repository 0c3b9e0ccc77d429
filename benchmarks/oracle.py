"""Freeze what the product computes and says, and compare a later version with it.

    python benchmarks/oracle.py freeze oracle.json
    python benchmarks/oracle.py compare oracle.json
    python benchmarks/oracle.py freeze oracle.json --only steps help

Steps are those of every environment × native integrator × form (single, vector, compiled, JAX in
float64), of every installed engine, and of variants with delays, noise and contact; then records
and `panel.json` of a small panel, weights of the trainers, public names and `--help` texts. It uses
public names alone. Bits are compared: physics must be equal on one machine and set of versions.
Weights and the panel depend on the processor's instruction sets too, which are noted; freeze both
versions on one machine.
"""

from __future__ import annotations

import argparse
import hashlib
import inspect
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from tqdm import tqdm

import integ_gym

STEPS = 60
LANES = 3

INTEGRATORS = (
    "explicit_euler",
    "symplectic_euler",
    "stormer_verlet",
    "rk4",
    "implicit_euler",
    "implicit_midpoint",
    "reference",
)

VARIANTS: dict[str, tuple[str, dict[str, Any]]] = {
    "latency": ("IntegPendulum-v0", {"action_latency": 0.03, "control_period": 0.1}),
    "sensor": ("IntegPendulum-v0", {"sensor_period": 0.1}),
    "noise": ("IntegPendulum-v0", {"observation_noise": 0.1}),
    "friction": ("IntegPendulum-v0", {"friction": 0.3, "damping": 0.1}),
    "stops": ("IntegPendulum-v0", {"joint_limit": 3.3, "start": "hanging"}),
    "clipped": ("IntegPendulum-v0", {"max_speed": 8.0}),
    "point mass": ("IntegPendulum-v0", {"mass_distribution": "point", "max_torque": 1.0}),
    "zero fallback": ("IntegPendulum-v0", {"fallback": "zero", "action_latency": 0.1}),
    "track": ("IntegCartPoleSwingUp-v0", {"track_limit": 0.3, "damping": 0.1}),
}
"""Name to environment and arguments, beside `dt`."""

PANEL = """
name = "oracle"
env_id = "IntegPendulum-v0"
control_period = 0.05
seeds = [0, 1]
episodes = 6

[environment]
max_torque = 1.0
duration = 4.0
start = "hanging"

[training]
total_steps = 8192
n_steps = 128

[[train]]
integrator = ["explicit_euler", "rk4"]
dt = 0.05

[[evaluate]]
integrator = ["explicit_euler", "rk4", "reference"]
dt = 0.05
"""

VOLATILE = {
    "created", "platform", "versions", "cost", "directory", "command", "training_costs", "file",
    "files", "query", "wall_seconds", "recorded_at",
}  # fmt: skip
"""Keys of `panel.json` that say when, where and how quickly."""


def digest(*arrays: Any) -> str:
    """SHA-256 of numbers, in 64 bits; zeros have no sign."""
    found = hashlib.sha256()
    for array in arrays:
        values = np.asarray(array, dtype=np.float64) + 0.0
        found.update(repr(values.shape).encode())
        found.update(values.tobytes())
    return found.hexdigest()[:16]


def _numbers(info: dict[str, Any]) -> list[Any]:
    return [
        info[name]
        for name in sorted(info)
        if not name.startswith("_")
        and np.asarray(info[name]).dtype.kind in "bif"
        and np.asarray(info[name]).size
    ]


def _actions(space: Any, count: int) -> list[Any]:
    generator = np.random.default_rng(7)
    if isinstance(space, gym.spaces.Discrete):
        return list(generator.integers(0, space.n, size=count))
    return list(generator.uniform(-1.2, 1.2, size=(count, *space.shape)) * space.high)


def _single(env_id: str, arguments: dict[str, Any]) -> str:
    env = gym.make(env_id, **arguments)
    seen: list[Any] = [env.reset(seed=3)[0]]
    over = False
    for action in _actions(env.action_space, STEPS):
        if over:
            seen.append(env.reset()[0])
        observation, reward, terminated, truncated, info = env.step(action)
        over = terminated or truncated
        seen += [observation, reward, terminated, truncated, *_numbers(info)]
    env.close()
    return digest(*seen)


def _vector(env_id: str, arguments: dict[str, Any]) -> str:
    envs = gym.make_vec(env_id, num_envs=LANES, **arguments)
    seen: list[Any] = [envs.reset(seed=3)[0]]
    space = envs.single_action_space
    actions = np.array(_actions(space, STEPS * LANES)).reshape(STEPS, LANES, *space.shape)
    for action in actions:
        observation, reward, terminated, truncated, info = envs.step(action)
        seen += [observation, reward, terminated, truncated, *_numbers(info)]
    envs.close()
    return digest(*seen)


def _compiled(env_id: str, arguments: dict[str, Any]) -> str:
    return _vector(env_id, {**arguments, "compiled": True})


def _functional(env_id: str, arguments: dict[str, Any]) -> str:
    import jax

    with jax.enable_x64(True):
        env = integ_gym.functional.make(env_id, dtype="float64", **arguments)
        step = jax.jit(env.step)
        state = env.initial(jax.random.key(3), lanes=(LANES,))
        seen = []
        space = gym.spec(env_id).make().action_space
        actions = np.array(_actions(space, STEPS * LANES)).reshape(STEPS, LANES, *space.shape)
        for number, action in enumerate(actions):
            key = jax.random.key(number)
            state, told = step(state, jax.numpy.asarray(action), key, env.default_params)
            seen += [told.observation, told.reward, told.terminated, told.truncated]
        return digest(*seen)


FORMS: dict[str, Callable[[str, dict[str, Any]], str]] = {
    "single": _single,
    "vector": _vector,
    "compiled": _compiled,
    "functional": _functional,
}


def _attempt(form: str, env_id: str, arguments: dict[str, Any]) -> str:
    try:
        return FORMS[form](env_id, arguments)
    except (ModuleNotFoundError, TypeError, ValueError) as error:
        return f"{type(error).__name__}"


def steps() -> Iterator[tuple[str, Any]]:
    """Name and digest of the steps of everything that can be stepped."""
    for env_id in integ_gym.ENVIRONMENTS:
        for integrator in INTEGRATORS:
            arguments = {"integrator": integrator, "dt": 0.02, "control_period": 0.04}
            for form in FORMS:
                if (form, integrator) == ("compiled", "reference"):
                    continue
                yield f"{env_id} {integrator} {form}", _attempt(form, env_id, arguments)
    for name, (env_id, variant) in VARIANTS.items():
        for form in FORMS:
            arguments = {"integrator": "rk4", "dt": 0.01, "control_period": 0.05, **variant}
            yield f"{name} {form}", _attempt(form, env_id, arguments)
    mixture = [{"integrator": "rk4", "dt": 0.05}, {"integrator": "explicit_euler", "dt": 0.025}]
    arguments = {"mixture": mixture, "control_period": 0.05}
    yield "mixture vector", _attempt("vector", "IntegPendulum-v0", arguments)


def engines() -> Iterator[tuple[str, Any]]:
    """Name and digest of steps of installed engines, each with its own default integrator."""
    names = (
        "mujoco", "mjx", "mujoco_warp", "drake", "pinocchio", "casadi", "dart", "pybullet",
        "sapien", "newton",
    )  # fmt: skip
    for engine in names:
        for env_id in ("IntegPendulum-v0", "IntegCartPoleSwingUp-v0"):
            for form in ("single", "vector"):
                arguments = {"engine": engine, "dt": 0.01, "control_period": 0.05, "duration": 1.0}
                yield f"{engine} {env_id} {form}", _attempt(form, env_id, arguments)


def _command(words: list[str], folder: str) -> str:
    line = [sys.executable, "-m", "integ_gym.cli", *words]
    own = {**os.environ, "COLUMNS": "100"}
    done = subprocess.run(line, cwd=folder, capture_output=True, text=True, env=own, check=True)
    return done.stdout


def panel() -> Iterator[tuple[str, Any]]:
    """Hashes of weights and records, and numbers of `panel.json`, of a small panel."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "oracle.toml").write_text(PANEL, encoding="utf-8")
        _command(["panel", "oracle.toml", "--out", "run", "--no-progress"], folder)
        told = json.loads(Path(folder, "run", "panel.json").read_text(encoding="utf-8"))
        yield from sorted(_leaves(told))
        store = integ_gym.EvidenceStore(Path(folder, "run", "evidence"))
        rows = store.query(
            "SELECT phase, policy_id, cell, perturbation, episode_index, success, "
            '"return" AS gained, failure_label, length FROM records ORDER BY ALL'
        ).to_pylist()
        for row in rows:
            place = " ".join(
                str(row.pop(name))
                for name in ("phase", "policy_id", "cell", "perturbation", "episode_index")
            )
            yield f"record {place}", {k: repr(v) for k, v in row.items()}


def _leaves(value: Any, place: str = "panel") -> Iterator[tuple[str, Any]]:
    """Numbers and truth values of nested data, by their place; sentences are not compared."""
    if isinstance(value, dict):
        for name, inner in value.items():
            if name not in VOLATILE:
                yield from _leaves(inner, f"{place}.{name}")
    elif isinstance(value, list):
        for number, inner in enumerate(value):
            yield from _leaves(inner, f"{place}[{number}]")
    elif isinstance(value, bool | int | float):
        yield place, repr(value)


def trainers() -> Iterator[tuple[str, Any]]:
    """Digest of the weights that each trainer ends with."""
    common = ["--integrator", "rk4", "--dt", "0.05", "--total-steps", "2048", "--seed", "5"]
    with tempfile.TemporaryDirectory() as folder:
        for trainer in ("fleet", "sb3"):
            _command(["train", "--trainer", trainer, *common, "--out", trainer], folder)
            card = json.loads(Path(folder, trainer, "policy.json").read_text(encoding="utf-8"))
            yield trainer, card["content_hash"]


def names() -> Iterator[tuple[str, Any]]:
    """Public names with their signatures, and public methods of classes."""
    for name in integ_gym.__all__:
        value = getattr(integ_gym, name)
        yield name, _signature(value)
        if inspect.isclass(value):
            own = (m for m in dir(value) if not m.startswith("_"))
            for method in own:
                yield f"{name}.{method}", _signature(inspect.getattr_static(value, method))


def _signature(value: Any) -> str:
    if not callable(value):
        return type(value).__name__ if inspect.isdatadescriptor(value) else "value"
    try:
        parameters = inspect.signature(value).parameters.values()
    except (TypeError, ValueError):
        return "callable"
    return ", ".join(f"{p.kind.name.lower()} {p.name}" for p in parameters)


def help_texts() -> Iterator[tuple[str, Any]]:
    """`--help` of every command."""
    commands = (
        "panel", "train", "evaluate", "check", "atlas", "diagnose", "engines", "census", "report",
        "watch", "play", "evidence", "evidence show", "evidence query", "evidence verify",
        "evidence seal", "evidence export", "evidence merge",
    )  # fmt: skip
    for command in ("", *commands):
        try:
            yield command or "integ-gym", _command([*command.split(), "--help"], ".")
        except subprocess.CalledProcessError as error:
            yield command, f"exit code {error.returncode}"


PARTS = {
    "steps": steps,
    "engines": engines,
    "trainers": trainers,
    "panel": panel,
    "names": names,
    "help": help_texts,
}


def main() -> int:
    """Freeze or compare; 1 where something differs."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("freeze", "compare"))
    parser.add_argument("file", type=Path, metavar="FILE")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS), metavar="PART")
    given = parser.parse_args()
    found = {part: dict(tqdm(PARTS[part](), desc=part, leave=False)) for part in given.only}
    if given.what == "freeze":
        given.file.write_text(json.dumps(found, indent=0, sort_keys=True), encoding="utf-8")
        print(f"{sum(map(len, found.values()))} values of {len(found)} parts in {given.file}")
        return 0
    frozen = json.loads(given.file.read_text(encoding="utf-8"))
    different = 0
    for part in given.only:
        before, now = frozen.get(part, {}), json.loads(json.dumps(found[part]))
        changed = [name for name in {**before, **now} if before.get(name) != now.get(name)]
        different += len(changed)
        print(f"{part}: {len(changed)} of {len({**before, **now})} differ")
        for name in changed[:20]:
            was, is_ = before.get(name, "absent"), now.get(name, "absent")
            print(f"  {name}: {str(was)[:60]!r} -> {str(is_)[:60]!r}")
    return 1 if different else 0


if __name__ == "__main__":
    sys.exit(main())
