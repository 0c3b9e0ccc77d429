"""What is attacked: finished runs of a small panel and of an evaluation.

The panel has fewer records than a page's sample takes, so that every forged one is in it.
"""

from __future__ import annotations

import contextlib
import io
import shutil
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import pyarrow.parquet as pq

from integ_gym.cli import main


def write_spec(
    file: Path,
    seeds: tuple[int, int] = (0, 1),
    *,
    name: str = "victim",
    top: str = 'episodes = 4\ntrainer = "sb3"\nbaselines = ["zero"]\n'
    "ladder = false\nperturbations = []",
    environment: str = "duration = 1.0",
    train: str = 'integrator = "rk4"\ndt = 0.05',
    evaluate: str = 'integrator = "rk4"\ndt = [0.05, 0.025]',
) -> Path:
    """Write the specification of a small panel; the file.

    Args:
        file: to write.
        seeds: of training.
        name: of the panel.
        top: further lines at the top.
        environment: further lines of its table.
        train: what is trained on.
        evaluate: where all is evaluated, and further tables.
    """
    text = f"""
name = "{name}"
env_id = "IntegPendulum-v0"
control_period = 0.05
seeds = {list(seeds)}
trace_every = 2
{top}

[environment]
start = "hanging"
max_torque = 1.0
{environment}

[training]
total_steps = 128
n_envs = 2
n_steps = 32
batch_size = 32
n_epochs = 1
net_arch = [4]
trace_every = 4

[[train]]
{train}

[[evaluate]]
{evaluate}
"""
    file.write_text(text, encoding="utf-8")
    return file


PICTURES = ("figures", "report.html")
"""Made of the rest, and not sealed."""


@dataclass(frozen=True)
class Task:
    """A command that makes a run.

    Attributes:
        words: of the command, but for its directory.
        done: a directory in which it ran undisturbed.
    """

    words: tuple[str, ...]
    done: Path

    def run(self, out: Path, workers: int = 1) -> tuple[int, str]:
        """Run it in a directory: exit code, and what it printed."""
        return command(*self.given(out, workers))

    def given(self, out: Path, workers: int) -> list[str]:
        """All words of the command."""
        return [*self.words, "--out", str(out), "--workers", str(workers), "--no-progress"]


@dataclass(frozen=True)
class Victim:
    """Two runs of one panel, and an evaluation of a policy of the first.

    Attributes:
        folder: holds specifications and directories of all.
    """

    folder: Path

    @property
    def panel(self) -> Task:
        """The panel that is attacked."""
        return Task(("panel", str(self.folder / "victim.toml")), self.run)

    @property
    def evaluation(self) -> Task:
        """An evaluation, which is sooner done."""
        policy = self.run / "policies" / "rk4-dt-0.05-seed0" / "policy.zip"
        cells = ("--integrator=rk4", "--dt=0.05", "--dt=0.025", "--episodes=4")
        words = ("evaluate", str(policy), "--env", "IntegPendulum-v0", *cells)
        return Task(words, self.folder / "evaluation")

    @property
    def run(self) -> Path:
        """The run that is attacked."""
        return self.folder / "victim"

    @property
    def other(self) -> Path:
        """A run of the same panel with other seeds, whose files may take the place of its own."""
        return self.folder / "other"

    def copied(self, folder: Path) -> Path:
        """A copy of the run, without its pictures."""
        return shutil.copytree(self.run, folder, ignore=shutil.ignore_patterns(*PICTURES))


def make_victim(folder: Path) -> Victim:
    """Make all runs in a folder."""
    victim = Victim(folder)
    tasks = [victim.panel, Task(("panel", str(folder / "other.toml")), victim.other)]
    write_spec(folder / "victim.toml")
    write_spec(folder / "other.toml", (2, 3))
    for task in (*tasks, victim.evaluation):
        code, told = task.run(task.done)
        assert code == 0, told
    return victim


def command(*words: object) -> tuple[int, str]:
    """Exit code of a command, and what it printed on both streams."""
    told = io.StringIO()
    with contextlib.redirect_stdout(told), contextlib.redirect_stderr(told):
        try:
            code = main([str(word) for word in words])
        except SystemExit as ended:
            code = int(ended.code or 0)
    return code, told.getvalue()


def records_of(run: Path) -> Counter[tuple[str, str]]:
    """How often each record is in a run, by id and content hash."""
    found: Counter[tuple[str, str]] = Counter()
    for file in sorted((run / "evidence").glob("*.parquet")):
        table = pq.read_table(file, columns=["record_id", "content_hash"])
        found.update(zip(*(column.to_pylist() for column in table.columns), strict=True))
    return found
