"""Freeze what the product computes and says, and compare a later version with it.

    python benchmarks/oracle.py freeze oracle.json
    python benchmarks/oracle.py compare oracle.json
    python benchmarks/oracle.py freeze oracle.json --only steps helps

Steps are those of every environment × native integrator × form (single, vector, compiled, JAX in
float64), of every installed engine, and of variants with delays, noise and contact; a form that
refuses is frozen with its error message. Then come the weights of both trainers; the verdicts,
numbers and records of a small panel with a declared family; public names with their signatures;
and every `--help` text. It uses public names alone. Bits are compared, so freeze and compare on one
machine with one set of versions. Sentences, times, places and versions of `panel.json` are not.
"""

from __future__ import annotations

import argparse
import hashlib
import inspect
import json
import os
import re
import subprocess
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from tqdm import tqdm

import integ_gym

STEPS = 60
LANES = 3

INTEGRATORS = (
    "explicit_euler", "symplectic_euler", "stormer_verlet", "rk4", "implicit_euler",
    "implicit_midpoint", "reference",
)  # fmt: skip

ENGINES = {
    "mujoco": ("Euler", "RK4", "discrete", "implicit", "implicitfast"),
    "mjx": ("Euler",),
    "mujoco_warp": ("Euler", "RK4"),
    "drake": ("runge_kutta3", "explicit_euler", "implicit_euler", "semi_explicit_euler", "sap"),
    "pinocchio": ("rk4", "symplectic_euler", "implicit_midpoint", "reference"),
    "casadi": ("rk", "collocation_legendre_2", "collocation_radau_3", "cvodes"),
    "dart": ("semi_implicit_euler",),
    "pybullet": ("semi_implicit_euler",),
    "sapien": ("tgs", "pgs"),
    "newton": ("featherstone", "mujoco_rk4"),
}
"""Engine to integrators of its own; the first is stepped in both forms."""

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
env_id = "IntegCartPole-v0"
control_period = 0.1
seeds = [0, 1, 2, 3, 4]
episodes = 4
trace_every = 2
ladder = false
family = [
  ["explicit_euler dt=0.1", "reference dt=0.1"],
  ["symplectic_euler dt=0.1", "reference dt=0.1"],
]
compare = [["symplectic_euler dt=0.1", "explicit_euler dt=0.1"]]

[environment]
duration = 3.0

[training]
total_steps = 16384
n_steps = 128

[[train]]
integrator = ["explicit_euler", "symplectic_euler"]
dt = 0.1

[[evaluate]]
integrator = ["explicit_euler", "symplectic_euler"]
dt = [0.1, 0.025]

[[perturbations]]
name = "late"
environment = { action_latency = 0.1 }
"""

LEFT_OUT = {
    "answer", "question", "warnings", "protocol_gaps", "reason", "achievability_reason",
    "created", "platform", "instruction_sets", "cost", "recorded_at",
    "command", "directory", "file", "query",
    "versions", "engine_version", "jax", "schema_version",
}  # fmt: skip
"""Keys of `panel.json` that hold sentences, times, places and versions."""

RECORD_FIELDS = (
    '"return"', "length", "success", "time_to_success", "terminated", "truncated", "seed",
    "energy_residual", "solver_status", "failure_label",
)  # fmt: skip
"""What an episode came to."""


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


def _functional(env_id: str, arguments: dict[str, Any]) -> str:
    import jax

    space = gym.spec(env_id).make().action_space
    actions = np.array(_actions(space, STEPS * LANES)).reshape(STEPS, LANES, *space.shape)
    with jax.enable_x64(True):
        env = integ_gym.functional.make(env_id, dtype="float64", **arguments)

        def step(state: Any, at: Any) -> tuple[Any, Any]:
            state, seen = env.step(state, at[1], jax.random.key(at[0]), env.default_params)
            return state, (seen.observation, seen.reward, seen.terminated, seen.truncated)

        @jax.jit
        def roll_out(actions: Any) -> Any:
            start = env.initial(jax.random.key(3), lanes=(LANES,))
            return jax.lax.scan(step, start, (jax.numpy.arange(STEPS), actions))[1]

        return digest(*roll_out(actions))


FORMS: dict[str, Callable[[str, dict[str, Any]], str]] = {
    "single": _single,
    "vector": _vector,
    "compiled": lambda env_id, arguments: _vector(env_id, {**arguments, "compiled": True}),
    "functional": _functional,
}


def _attempt(form: str, env_id: str, arguments: dict[str, Any]) -> str:
    try:
        return FORMS[form](env_id, arguments)
    except (ImportError, TypeError, ValueError) as error:
        return f"{type(error).__name__}: {error}"


def steps() -> Iterator[tuple[str, Any]]:
    """Name and digest of the steps of everything that can be stepped."""
    own = {"dt": 0.02, "control_period": 0.04}
    cases = [
        (f"{env_id} {integrator}", form, env_id, {"integrator": integrator, **own})
        for env_id in integ_gym.ENVIRONMENTS
        for integrator in INTEGRATORS
        for form in FORMS
    ]
    own = {"integrator": "rk4", "dt": 0.01, "control_period": 0.05}
    cases += [
        (name, form, env_id, {**own, **variant})
        for name, (env_id, variant) in VARIANTS.items()
        for form in FORMS
    ]
    members = [{"integrator": "rk4", "dt": 0.05}, {"integrator": "explicit_euler", "dt": 0.025}]
    mixture = {"mixture": members, "control_period": 0.05}
    cases += [("mixture", form, "IntegPendulum-v0", mixture) for form in FORMS]
    for name, form, env_id, arguments in _bar(cases, "steps"):
        yield f"{name} {form}", _attempt(form, env_id, arguments)


def engines() -> Iterator[tuple[str, Any]]:
    """Name and digest of steps of the installed engines, on each integrator named above."""
    own = {"dt": 0.01, "control_period": 0.05, "duration": 1.0}
    cases = [
        (engine, integrator, form, env_id)
        for engine, integrators in ENGINES.items()
        for integrator in integrators
        for env_id in ("IntegPendulum-v0", "IntegCartPoleSwingUp-v0")
        for form in ("single", "vector")
        if form == "single" or integrator == integrators[0]
    ]
    for engine, integrator, form, env_id in _bar(cases, "engines"):
        arguments = {"engine": engine, "integrator": integrator, **own}
        yield f"{engine} {integrator} {env_id} {form}", _attempt(form, env_id, arguments)


def _bar(cases: Sequence[Any], name: str) -> Any:
    return tqdm(cases, desc=name, leave=False)


def _command(words: Sequence[str], folder: str) -> str:
    line = [sys.executable, str(Path(sys.executable).with_name("integ-gym")), *words]
    own = {**os.environ, "COLUMNS": "100", "PYTHONWARNINGS": "ignore"}
    done = subprocess.run(line, cwd=folder, capture_output=True, text=True, env=own)
    if done.returncode:
        raise RuntimeError(f"{' '.join(words)}: {done.stderr[-2000:]}")
    return done.stdout


def panel() -> Iterator[tuple[str, Any]]:
    """Leaves of `panel.json` of a small panel, then what its records hold, by group of episodes."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "oracle.toml").write_text(PANEL, encoding="utf-8")
        _command(["panel", "oracle.toml", "--out", "run", "--no-progress"], folder)
        text = Path(folder, "run", "panel.json").read_text(encoding="utf-8")
        yield from sorted(_leaves(json.loads(text)))
        store = integ_gym.EvidenceStore(Path(folder, "run", "evidence"))
        rows = store.query(
            "SELECT phase, policy_id, cell, perturbation, episode_index, content_hash, "
            f"{', '.join(RECORD_FIELDS)} FROM records ORDER BY ALL"
        ).to_pylist()
    groups = defaultdict(list)
    for row in rows:
        place = [row.pop(name) for name in ("phase", "policy_id", "cell", "perturbation")]
        groups[" | ".join(map(str, place))].append(row)
    for place, members in groups.items():
        hashes = sorted(row.pop("content_hash") for row in members)
        yield f"labels {place}", dict(Counter(str(row["failure_label"]) for row in members))
        yield f"outcomes {place}", hashlib.sha256(repr(members).encode()).hexdigest()[:16]
        yield f"content hashes {place}", hashlib.sha256("".join(hashes).encode()).hexdigest()[:16]


def _leaves(value: Any, place: str = "panel") -> Iterator[tuple[str, Any]]:
    """Numbers, truth values, names and codes of nested data, by their place."""
    if isinstance(value, dict):
        for name, inner in value.items():
            if name not in LEFT_OUT:
                yield from _leaves(inner, f"{place}.{name}")
    elif isinstance(value, list):
        for number, inner in enumerate(value):
            yield from _leaves(inner, f"{place}[{number}]")
    else:
        yield place, repr(value)


def trainers() -> Iterator[tuple[str, Any]]:
    """Digest of the weights that each trainer ends with."""
    common = ["--integrator", "rk4", "--dt", "0.05", "--total-steps", "2048", "--seed", "5"]
    with tempfile.TemporaryDirectory() as folder:
        for trainer in _bar(("fleet", "sb3"), "trainers"):
            _command(["train", "--trainer", trainer, *common, "--out", trainer], folder)
            card = json.loads(Path(folder, trainer, "policy.json").read_text(encoding="utf-8"))
            yield trainer, card["content_hash"]


def names() -> Iterator[tuple[str, Any]]:
    """Public names with their signatures, and those of the methods of classes and of modules."""
    for name in _bar(integ_gym.__all__, "names"):
        value = getattr(integ_gym, name)
        yield name, _signature(value)
        if inspect.isclass(value):
            members = [member for member in dir(value) if not member.startswith("_")]
        else:
            members = getattr(value, "__all__", []) if inspect.ismodule(value) else []
        for member in members:
            yield f"{name}.{member}", _signature(getattr(value, member))


def _signature(value: Any) -> str:
    """Kind, name and default of every parameter; the type of what cannot be called."""
    if not callable(value):
        return type(value).__name__
    try:
        parameters = inspect.signature(value).parameters.values()
    except (TypeError, ValueError):
        return "callable"
    parts = [
        f"{p.kind.name.lower()} {p.name}" + ("" if p.default is p.empty else f"={p.default!r}")
        for p in parameters
    ]
    return re.sub(r" at 0x[0-9a-f]+", "", ", ".join(parts))


def helps() -> Iterator[tuple[str, Any]]:
    """`--help` of every command and of what the commands have below them."""
    text = _command(["--help"], ".")
    yield "integ-gym", text
    for name in _bar(re.findall(r"^  (\w+) {2,}\S", text.split("commands (")[1], re.M), "helps"):
        text = _command([name, "--help"], ".")
        yield name, text
        if below := re.search(r"\{([a-z,]+)\} \.\.\.", text):
            for inner in below[1].split(","):
                yield f"{name} {inner}", _command([name, inner, "--help"], ".")


PARTS = {part.__name__: part for part in (steps, engines, trainers, panel, names, helps)}


def main() -> int:
    """Freeze or compare; 1 where something differs."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("freeze", "compare"))
    parser.add_argument("file", type=Path, metavar="FILE")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS), metavar="PART")
    given = parser.parse_args()
    found = {part: dict(PARTS[part]()) for part in _bar(given.only, "parts")}
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
