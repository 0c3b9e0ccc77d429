"""Use each extra alone, in an empty environment: the commands and imports that it is named for.

    .venv/bin/python .ci/extras.py                 those that the README's commands need
    .venv/bin/python .ci/extras.py --all           every extra, engines included: several GB
    .venv/bin/python .ci/extras.py train numba     these

Each environment gets the checkout with one extra and the pins, and a folder with nothing in it. Two
are used at once; they share the cache of downloads. Isaac Lab and dm_control are no extras: `make
isaaclab` and `make dm_control` set them up, and their tests use them.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent

STEP = """
import gymnasium as gym, integ_gym
env = gym.make("IntegPendulum-v0", {arguments})
env.reset(seed=0)
print(env.step([0.5])[0])
"""

RECORD = """
import gymnasium as gym, integ_gym
env = gym.make("IntegPendulum-v0", integrator="rk4", dt=0.05, duration=1.0)
env = integ_gym.RecordEvidence(env, "run/evidence", integ_gym.EpisodeContext("run", "rk4"))
env.reset(seed=0)
while not env.step([0.5])[3]:
    pass
env.close()
"""


SPEC = """
name = "small"
env_id = "IntegPendulum-v0"
control_period = 0.05
seeds = [0]
episodes = 2
baselines = ["random", "handmade"]
environment = { max_torque = 1.0, duration = 1.0 }
training = { total_steps = 1024, n_steps = 64 }
train = [{ integrator = "rk4", dt = 0.05 }]
evaluate = [{ integrator = "rk4", dt = 0.05 }]
"""


SB3 = "integ-gym train --integrator rk4 --dt 0.05 --total-steps 512 --n-steps 64 --out policy"
FLEET = "integ-gym train --trainer fleet --integrator rk4 --dt 0.05 --total-steps 1024 --out policy"


def _python(code: str) -> list[str]:
    return ["python", "-c", code]


def _step(**arguments: object) -> list[str]:
    return _python(STEP.format(arguments=", ".join(f"{k}={v!r}" for k, v in arguments.items())))


ONNX = """
import onnx
from onnx import TensorProto, helper
seen, action = (
    helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", size])
    for name, size in (("seen", 3), ("action", 1))
)
zeros = helper.make_tensor("zeros", TensorProto.FLOAT, [3, 1], [0.0] * 3)
node = helper.make_node("MatMul", ["seen", "zeros"], ["action"])
graph = helper.make_graph([node], "still", [seen], [action], [zeros])
known = {"ir_version": 10, "opset_imports": [helper.make_opsetid("", 17)]}  # to onnxruntime
onnx.save(helper.make_model(graph, **known), "still.onnx")
"""


FUNCTION = "def still(observation):\n    return [0.0]\n"
EVALUATE = (
    "integ-gym evaluate --policy mine:still --env IntegPendulum-v0 --integrator rk4 --dt 0.05 "
    "--episodes 2 --out judged"
)
VERIFY = "integ-gym evidence verify judged"

USES: dict[str, list[str | list[str]]] = {
    "": [_step(integrator="rk4", dt=0.05), "integ-gym --help"],
    "evidence": [
        _python(RECORD),
        "integ-gym evidence query run 'SELECT record_id, success FROM records LIMIT 3'",
        "integ-gym evidence show run $(integ-gym evidence query run --format csv "
        "'SELECT record_id FROM records LIMIT 1' | tail -n 1)",
        "integ-gym evidence verify run",
    ],
    "train": [SB3, _python("from integ_gym import DiscretizationCallback, train_ppo")],
    "fleet": [FLEET, _python("from integ_gym import functional, train_fleet")],
    "report": [
        EVALUATE,
        VERIFY,
        "integ-gym report judged",
        "printf 'policy,success\\na,1\\na,0\\n' > mine.csv && integ-gym judge mine.csv --out mine",
        "integ-gym diagnose --plant pendulum --integrator rk4 --dt 0.1 --out diagnosed",
        "integ-gym engines --engine native",
        "integ-gym census --published gymnasium --out census",
    ],
    "panel": [
        "integ-gym panel small.toml --out run",
        "integ-gym evidence verify run",
        "integ-gym evaluate run/policies/rk4*/policy.safetensors --env IntegPendulum-v0 "
        "--integrator rk4 --dt 0.05 --episodes 2 --out judged",
        "integ-gym check --integrator symplectic_euler --dt 0.05 --seeds 2 "
        "--train-arg total_steps=1024 --train-arg n_steps=64 --out checked",
        "integ-gym diagnose --example drift --out drift",
    ],
    "render": [
        _step(integrator="rk4", dt=0.05, render_mode="rgb_array"),
        "timeout 5 integ-gym play; test $? -eq 124",  # it goes on until its window is closed
    ],
    "numba": [
        _python(
            "import gymnasium as gym, integ_gym\n"
            "envs = gym.make_vec('IntegPendulum-v0', 8, compiled=True)\n"
            "envs.reset(seed=0)\n"
            "print(envs.step(envs.action_space.sample())[0].shape)"
        )
    ],
    "hub": [_python("import huggingface_hub, integ_gym")],
    "onnx": [
        _python(ONNX),
        "integ-gym evaluate still.onnx --env IntegPendulum-v0 --integrator rk4 --dt 0.05 "
        "--episodes 2 --out judged",
    ],
    "ray": [_python("import ray, integ_gym")],
    "dask": [_python("import dask, distributed, integ_gym")],
    "slurm": [_python("import submitit, integ_gym")],
    "versions": [_python("import uv, integ_gym.support.interpreters")],
    "storage": [_python("import obstore, fsspec, integ_gym")],
    "robotics": [_python("import gymnasium_robotics, mujoco, integ_gym")],
    "playground": [_python("import mujoco_playground, integ_gym")],
    "brax": [_python("import brax, integ_gym")],
    "all": [SB3, "integ-gym panel small.toml --out run"],
    "exchange": [
        _python(RECORD),
        "integ-gym evidence export run --to minari --out datasets",
        "integ-gym evidence export run --to mcap --out logs",
    ],
    **{
        engine: [_step(engine=engine, integrator=integrator, dt=0.01)]
        for engine, integrator in {
            "mujoco": "Euler",
            "mjx": "Euler",
            "mujoco_warp": "Euler",
            "newton": "featherstone",
            "casadi": "rk",
            "dart": "semi_implicit_euler",
            "drake": "runge_kutta3",
            "pinocchio": "rk4",
            "pybullet": "semi_implicit_euler",
            "sapien": "tgs",
        }.items()
    },
}
"""Extra to what a user of it does."""

FIRST = ("train", "panel", "report", "fleet", "evidence", "render", "")
"""Those that the README's commands need, the longest first."""


def main() -> int:
    """Use each; 1 if one does not suffice."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("extras", nargs="*", metavar="EXTRA", help="default: the README's first")
    parser.add_argument("--all", action="store_true", help="every extra in the table")
    given = parser.parse_args()
    known = _extras()
    if different := known ^ (set(USES) - {""}):
        parser.error(f"pyproject.toml and USES differ in {', '.join(sorted(different))}")
    if unknown := set(given.extras) - known - {""}:
        parser.error(f"no extra {', '.join(sorted(unknown))}; there are {', '.join(sorted(known))}")
    chosen = given.extras or (USES if given.all else FIRST)
    with ThreadPoolExecutor(2) as pool:
        failed = [
            extra for extra, good in zip(chosen, pool.map(_use, chosen), strict=True) if not good
        ]
    for extra in failed:
        print(f"does not suffice: {extra or 'no extra'}")
    return 1 if failed else 0


def _extras() -> set[str]:
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    return set(tomllib.loads(text)["project"]["optional-dependencies"])


def _use(extra: str) -> bool:
    """Whether everything in an environment with this extra alone ends with 0."""
    begun = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        bin_ = Path(folder, "venv", "bin")
        subprocess.run([sys.executable, "-m", "venv", "--without-pip", bin_.parent], check=True)
        target = f"{ROOT}[{extra}]" if extra else str(ROOT)
        line = [ROOT / ".ci" / "install", sys.executable, "--editable", target]
        subprocess.run(line, check=True, env={**os.environ, "INTO": str(bin_ / "python")})
        Path(folder, "small.toml").write_text(SPEC, encoding="utf-8")
        Path(folder, "mine.py").write_text(FUNCTION, encoding="utf-8")
        lines = [f"{extra or 'no extra'}: installed in {time.monotonic() - begun:.0f} s"]
        path = f"{bin_}{os.pathsep}{os.environ['PATH']}"
        own = {**os.environ, "PATH": path, "SDL_VIDEODRIVER": "dummy"}
        for use in USES[extra]:
            words = use if isinstance(use, list) else ["sh", "-c", use]
            done = subprocess.run(words, cwd=folder, env=own, capture_output=True, text=True)
            shown = use if isinstance(use, str) else "python -c …"
            lines.append(f"  {'FAILED' if done.returncode else 'ok    '} {shown}")
            if done.returncode:
                lines += [done.stdout[-1000:], done.stderr[-2000:]]
                break
        print(*lines, f"  {time.monotonic() - begun:.0f} s in all", sep="\n", flush=True)
        return not done.returncode


if __name__ == "__main__":
    sys.exit(main())
