"""How large the house is, and how many of its files common journeys cross.

    python benchmarks/house.py [--tree CHECKOUT] [--journeys]

A code line holds something other than a comment, a docstring or nothing. `--tree` counts another
checkout, for a table of before and after. A journey counts the files of the six roots in which a
function is called; what runs only as a module is imported does not count.
"""

from __future__ import annotations

import argparse
import ast
import os
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import tokenize
from pathlib import Path
from types import FrameType

ROOT = Path(__file__).resolve().parents[1]
ROOTS = ("package", "support", "envs", "evidence", "train", "eval")
# The first pattern that a path matches is its capability.
CAPABILITIES = {
    "physics written once": r"envs/(ops|arithmetic|mechanics|plants|integrators)\b",
    "what a discretization does to energy and order": r"envs/(numerics/|maps/)",
    "engines": r"envs/engines/",
    "testbeds, environments of others": (
        r"envs/(testbeds/|delayed|foreign|rediscretized|environments/(stated|rediscretized))"
    ),
    "drawing": r"envs/rendering/",
    "environments and tasks": r"envs/",
    "policy files": r"train/policy_files/",
    "fleet": r"train/fleet/",
    "training": r"train/",
    "records": r"evidence/",
    "panel": r"eval/(panel/|contract\.py)",
    "statistics and verdicts": r"eval/(statistics|verdict|power|loss_check)",
    "page and figures": r"(eval/report/|support/(figures|pages))",
    "films and playing": r"eval/(film|play|watch)",
    "diagnosis": r"eval/diagnosis/",
    "census": r"eval/census/",
    "atlas and check": r"eval/",
    "commands": r"package/",
    "processes, files, terminal": r"support/",
}


def code_lines(path: Path) -> set[int]:
    """Numbers of the lines that hold code."""
    lines: set[int] = set()
    begins = True
    with path.open("rb") as stream:
        tokens = list(tokenize.tokenize(stream.readline))
    layout = (tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENCODING)
    for token, following in zip(tokens, [*tokens[1:], tokens[-1]], strict=True):
        if token.type in layout:
            begins = True
        elif token.type not in (tokenize.COMMENT, tokenize.NL, tokenize.ENDMARKER):
            if not (
                begins and token.type == tokenize.STRING and following.type == tokenize.NEWLINE
            ):
                lines.update(range(token.start[0], token.end[0] + 1))
            begins = False
    return lines


def import_lines(path: Path) -> set[int]:
    """Numbers of the lines of imports."""
    tree = ast.parse(path.read_bytes())
    found = (node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom))
    return {n for node in found for n in range(node.lineno, (node.end_lineno or node.lineno) + 1)}


def print_size(tree: Path) -> None:
    """The table by capability, and the whole."""
    sizes, imports, lists = {}, 0, 0
    by_capability: dict[str, list[int]] = {name: [] for name in CAPABILITIES}
    for path in sorted(p for root in ROOTS for p in (tree / root).rglob("*.py")):
        name = path.relative_to(tree).as_posix()
        lines = code_lines(path)
        sizes[name] = len(lines)
        imports += len(lines & import_lines(path))
        if path.name == "__init__.py":
            lists += len(path.read_text(encoding="utf-8").splitlines())
        capability = next(c for c, pattern in CAPABILITIES.items() if re.match(pattern, name))
        by_capability[capability].append(len(lines))
    print("| capability | code lines | files |\n|---|---|---|")
    for capability, counted in by_capability.items():
        print(f"| {capability} | {sum(counted)} | {len(counted)} |")
    total = sum(sizes.values())
    median = statistics.median(n for name, n in sizes.items() if not name.endswith("__init__.py"))
    tests = sum(len(code_lines(path)) for path in (tree / "tests").rglob("*.py"))
    print(
        f"| **all** | **{total}** | **{len(sizes)}** |\n\n"
        f"median file {median:g}, imports {imports / total:.1%}, "
        f"deepest file {max(name.count('/') for name in sizes)} folders down, "
        f"__init__.py {lists} lines in all, tests {tests}"
    )


def _is_import(frame: FrameType | None) -> bool:
    """Whether a frame runs because a module of the six roots is imported."""
    while frame is not None:
        code = frame.f_code
        imported = code.co_name == "<module>" and frame.f_globals["__name__"] != "__main__"
        if imported and code.co_filename.startswith(f"{ROOT}/"):
            return True
        frame = frame.f_back
    return False


def follow(folder: str) -> None:
    """Note in `folder` when a function of each file is first called in this process."""
    seen: set[str] = set()
    log = (Path(folder) / str(os.getpid())).open("a", encoding="utf-8", buffering=1)

    def note(frame: FrameType, event: str, _: object) -> None:
        path = frame.f_code.co_filename
        if event != "call" or path in seen:
            return
        name = path.removeprefix(f"{ROOT}/")
        if name.split("/")[0] not in ROOTS:
            seen.add(path)
        elif not _is_import(frame):
            seen.add(path)
            log.write(f"{time.time()} {name}\n")

    threading.setprofile(note)
    sys.setprofile(note)


def walk(code: str, *given: str, until: str | None = None) -> list[str]:
    """Files that a Python process and those it starts enter, until one matches `until`.

    A line of `code` that is `follow()` begins the journey; without one it begins at once. `until`
    is a pattern in the last folder of `given`.
    """
    with tempfile.TemporaryDirectory() as folder:
        begin = (
            f"import sys; sys.path.insert(0, {str(ROOT / 'benchmarks')!r})\n"
            f"import house; house.follow({folder!r})"
        )
        environ = {**os.environ, "PYTHONPATH": folder}
        if "follow()" in code:
            code = code.replace("follow()", begin)
        else:
            (Path(folder) / "sitecustomize.py").write_text(begin, encoding="utf-8")
        subprocess.run(
            [sys.executable, "-c", code, *given], check=True, stdout=subprocess.DEVNULL, env=environ
        )
        lines = [
            line.split()
            for log in Path(folder).glob("[0-9]*")
            for line in log.read_text().splitlines()
        ]
    end = (
        min(path.stat().st_mtime for path in Path(given[-1]).glob(until)) if until else float("inf")
    )
    return sorted({name for when, name in lines if float(when) <= end})


MAKE = """
import gymnasium, integ_gym
follow()
env = gymnasium.make("IntegPendulum-v0", integrator="rk4", dt=0.05)
"""
STEP = """
import gymnasium, integ_gym
env = gymnasium.make("IntegPendulum-v0", integrator="rk4", dt=0.05)
env.reset(seed=0)
action = env.action_space.sample()
follow()
env.step(action)
"""
EPISODE = """
import sys
import gymnasium, integ_gym
env = gymnasium.make("IntegPendulum-v0", integrator="rk4", dt=0.05)
context = integ_gym.EpisodeContext(run_id="a", cell="rk4", policy_id="random")
env = integ_gym.RecordEvidence(env, sys.argv[1], context)
env.reset(seed=0)
action = env.action_space.sample()
follow()
while not any(env.step(action)[2:4]):
    pass
env.close()
"""
PANEL = """
name = "small"
env_id = "IntegPendulum-v0"
control_period = 0.05
trainer = "fleet"
seeds = [1, 2]
episodes = 2
[environment]
duration = 2.0
[training]
total_steps = 4096
[[train]]
integrator = "rk4"
dt = 0.05
[[evaluate]]
integrator = ["rk4", "symplectic_euler"]
dt = 0.05
"""
WORDS = """
import sys
from pathlib import Path
from integ_gym.eval.panel.outputs import panel_of, read_call
from integ_gym.eval.panel.plan import read_planned_spec
from integ_gym.eval.panel.run_directory import RunDirectory
directory = RunDirectory(Path(sys.argv[1]), {})
spec = read_planned_spec(directory.manifest()["specification"])
called = read_call(directory)
follow()
print(panel_of(spec, directory, called).answer)
"""
COMMAND = "import sys; from integ_gym.cli import main; sys.exit(main(sys.argv[1:]))"


def print_journeys() -> None:
    """Each journey, the number of its files and their names."""
    with tempfile.TemporaryDirectory() as folder:
        spec, run = Path(folder) / "spec.toml", f"{folder}/run"
        spec.write_text(PANEL, encoding="utf-8")
        journeys = {
            "gym.make": walk(MAKE),
            "env.step": walk(STEP),
            "episode to Parquet": walk(EPISODE, f"{folder}/evidence"),
            "command to first policy": walk(
                COMMAND, "panel", str(spec), "--out", run, until="units/train-*.json"
            ),
            "records to words": walk(WORDS, run),
        }
    for name, files in journeys.items():
        print(f"{name}: {len(files)} files")
        print("    " + "\n    ".join(files))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--tree", type=Path, default=ROOT)
    parser.add_argument("--journeys", action="store_true")
    arguments = parser.parse_args()
    if arguments.journeys:
        print_journeys()
    else:
        print_size(arguments.tree)
