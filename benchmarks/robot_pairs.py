"""How long a robot's episode takes, evaluated and recorded, beside `robot_plain.py`'s loop.

``python benchmarks/robot_pairs.py go1:Go1 DIR``: the policy at its file's settings, from the same
starts, in pairs: the loop on one core, then the evaluation with its traces written on several. By
processor time it is how many times as fast it is where no other program runs. MuJoCo's share of the
loop, on as many cores, is about the ceiling.
"""

import os
import resource
import statistics
import tempfile
import time
import warnings
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import mujoco
from robot_plain import plain_episode
from robots import open_robot, robot_parser

from integ_gym.eval.panel.cells import Cell
from integ_gym.eval.panel.episodes import Subject, evaluate
from integ_gym.eval.panel.evaluate import tasks_of
from integ_gym.eval.panel.spec import PanelSpec
from integ_gym.evidence.store import EvidenceStore
from integ_gym.support.processes import release_memory
from integ_gym.train.policy_files.onnx import read_onnx


def record(spec, episodes, out):
    """Evaluate the policy and write its records; this process, time spent, of the clock and of the
    processor, s, and most memory so far, MB."""
    warnings.simplefilter("ignore")  # about meshes that only show
    subjects, store = subjects_of(spec), EvidenceStore(out)
    _, begin, busy = spec.testbed.compiled, time.perf_counter(), time.process_time()
    release_memory()
    store.commit_all(f"from-{episodes.start}", evaluate(spec, subjects, episodes, store, {}))
    spent = time.perf_counter() - begin, time.process_time() - busy
    return os.getpid(), *spent, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def subjects_of(spec):
    """The policy in its file's settings."""
    policy = read_onnx(Path(spec.environment["folder"], "policy.onnx"))
    return [Subject(policy, (Cell.of(*spec.grid, "grid"),))]


def by_worker(measured):
    """Of each worker time spent, of the clock and of the processor, s, and most memory, MB."""
    found = defaultdict(list)
    for worker, *numbers in measured:
        found[worker].append(numbers)
    for own in found.values():
        clock, processor, memory = zip(*own, strict=True)
        yield sum(clock), sum(processor), max(memory)


def stand(model, period, qpos, qvel, command):
    """An episode's steps and readings by MuJoCo, under the controls of the keyframe."""
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, model.key_ctrl[0]
    for _ in range(round(10.0 / period)):
        mujoco.mj_step(model, data, round(period / model.opt.timestep))
        mujoco.mj_forward(model, data)


def main():
    parser = robot_parser(__doc__, 20)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--pairs", type=int, default=5)
    given = parser.parse_args()
    path, arguments = f"examples.robots.{given.robot}", {"folder": given.folder}
    (testbed, session), name = open_robot(given), given.robot.partition(":")[0]
    model, home = testbed.compiled.model, testbed.home
    spec = PanelSpec(
        name="pair", env_id=path, environment=arguments, control_period=home.control_period,
        train=(), grid=(home,), seeds=(), ladder=False, episodes=given.episodes,
    )  # fmt: skip
    (env,), starts = testbed.make(home, 1).envs, []
    for episode in range(given.episodes):
        _, info = env.reset(seed=spec.start_seed(0, episode))
        state = env.state
        starts.append((state[: model.nq], state[model.nq :], info["command"]))
    (tasks,), ratios = tasks_of(spec, [subjects_of(spec)], given.workers), []
    parts = [part for _, part in tasks.values()]
    with ProcessPoolExecutor(given.workers, get_context("spawn")) as pool:
        for pair in range(-1, given.pairs):  # the first is not counted
            begin, busy = time.perf_counter(), time.process_time()
            for start in starts:
                plain_episode(name, model, session, *start)
            plain = time.perf_counter() - begin, time.process_time() - busy
            bare = time.process_time()
            for start in starts:
                stand(model, home.control_period, *start)
            bare = time.process_time() - bare
            with tempfile.TemporaryDirectory() as out:
                measured = pool.map(record, [spec] * len(parts), parts, [out] * len(parts))
                *spent, memory = zip(*by_worker(measured), strict=True)
            if pair >= 0:
                own = [one / max(each) for one, each in zip(plain, spent, strict=True)]
                ratios.append([*own, given.workers * plain[1] / bare])
                each = [1e3 * one / given.episodes for one in (plain[0], max(spent[0]))]
                words = "{:.0f} ms an episode by the loop, {:.0f} ms evaluated".format(*each)
                speedup = f"{own[0]:.2f} times as fast, by processor time {own[1]:.2f}"
                print(f"{words}: {speedup}, {sum(memory):.0f} MB", flush=True)
    clock, processor, ceiling = map(statistics.median, zip(*ratios, strict=True))
    words = f"median {clock:.2f} times as fast, by processor time {processor:.2f}"
    print(f"{words}; MuJoCo alone on as many cores: {ceiling:.2f}")


if __name__ == "__main__":
    main()
