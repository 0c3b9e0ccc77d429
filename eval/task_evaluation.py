"""Evaluation of a policy on a MuJoCo task: one environment per cell, cells side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from integ_gym.eval.artefact import build_artefact
from integ_gym.eval.cells import Cell
from integ_gym.eval.evaluation import Conditions, OnCell, Subject, context_of, inference_latency
from integ_gym.eval.evaluation_units import evaluate_batch
from integ_gym.eval.existing.doubts import doubts_of
from integ_gym.eval.existing.evaluate import begin, directory_of, evaluation_facts, outcome
from integ_gym.eval.existing.policy import Existing
from integ_gym.eval.matrix import Matrix
from integ_gym.eval.mujoco_task import TaskPanel, home_cell
from integ_gym.eval.panel_artefact import write_outputs
from integ_gym.eval.panel_model import Panel
from integ_gym.eval.run_directory import RunDirectory
from integ_gym.evidence.labels import Replays
from integ_gym.evidence.recorder import RecordEvidence
from integ_gym.evidence.store import EvidenceStore
from integ_gym.train.box_baselines import box_baselines
from integ_gym.train.worker import Progress, cores

Successes: TypeAlias = tuple[bool, ...]


def evaluate_task(
    existing: Existing,
    spec: TaskPanel,
    out: Path,
    command: str,
    on_cell: Callable[[int], None] = lambda policies: None,
    on_doubt: Callable[[str], None] = lambda doubt: None,
) -> Panel:
    """Evaluate a policy and the baselines, and write the usual directory.

    Args:
        existing: the policy.
        spec: what :func:`integ_gym.eval.mujoco_task.plan_task` made.
        out: directory.
        command: how to run this again, for the page.
        on_cell: told after every cell how many policies were in it.
        on_doubt: called at the end, with each sentence that casts doubt on the result.

    Returns:
        What ``panel.json`` holds; ``warnings`` lists the doubts.

    Raises:
        RunDirectoryError: for a directory that holds something else.
    """
    directory = directory_of(existing, spec, out)
    with spec.environment_of(spec.columns()[0]) as env:
        baselines = box_baselines(env.action_space)
    with directory.opened():
        _run(spec, directory, begin(existing, spec, directory, baselines, on_cell), on_cell)
        layout, matrix = outcome(existing, spec, directory)
        warnings = _doubts(existing, spec, directory, matrix)
        for doubt in warnings:
            on_doubt(doubt)
        more = {"remark": _returns(existing, spec, matrix), "warnings": warnings}
        facts = evaluation_facts(existing, spec, directory, command, _workers(spec), **more)
        panel = build_artefact(layout, matrix, facts)
        write_outputs(panel, directory)
    return panel


def _run(
    spec: TaskPanel,
    directory: RunDirectory,
    waiting: Sequence[Subject],
    on_cell: Callable[[int], None],
) -> None:
    """Evaluate policies, each finished by one commit."""
    if not waiting:
        return
    with Progress().pool(_workers(spec)) as pool:
        for subject in waiting:
            run = partial(_evaluate, spec, pool)
            evaluate_batch(spec, directory, (subject,), lambda _, policies: on_cell(policies), run)


def _workers(spec: TaskPanel) -> int:
    return min(cores(), len(spec.grid))


def _evaluate(
    spec: TaskPanel,
    pool: ProcessPoolExecutor,
    subjects: Sequence[Subject],
    conditions: Conditions,
    store: EvidenceStore,
    batch: str,
    on_cell: OnCell,
) -> None:
    """The counterpart of :func:`integ_gym.eval.evaluation.evaluate`."""
    tables = (
        table
        for subject in subjects
        for table in _tables(_Play(spec, subject, conditions, store), pool, on_cell)
    )
    store.commit_all(batch, tables)


def _tables(play: _Play, pool: ProcessPoolExecutor, on_cell: OnCell) -> Iterator[Any]:
    """The records of every cell; the home comes first, because it labels the others' failures."""
    cells, at_home = play.subject.cells, None
    if play.subject.home is not None:
        table, at_home = pool.submit(play, cells[0]).result()
        on_cell(cells[0], 1)
        yield table
        cells = cells[1:]
    played = pool.map(partial(play, at_home=at_home), cells)
    for cell, (table, _) in zip(cells, played, strict=True):
        on_cell(cell, 1)
        yield table


@dataclass(frozen=True)
class _Play:
    """Plays the paired episodes of one policy in a cell, one after another."""

    spec: TaskPanel
    subject: Subject
    conditions: Conditions
    store: EvidenceStore

    def __call__(self, cell: Cell, at_home: Successes | None = None) -> tuple[Any, Successes]:
        """The records as a table, and which episodes succeeded.

        Args:
            cell: where.
            at_home: which episodes of the same starts succeeded at home, of a policy with one.
        """
        task, first = self.spec.environment_of(cell), self.conditions.episode_seed
        latency = inference_latency(self.subject.policy, task.reset(seed=first)[0][None])
        context = context_of(self.subject, cell, self.conditions, latency)
        env = RecordEvidence(task, self.store, context, commit_on_close=False)
        seeds = range(first, first + self.conditions.episodes)
        success = tuple(self._episode(env, seed) for seed in seeds)
        table = env.take(_replays(at_home))
        env.close()
        return table, success

    def _episode(self, env: RecordEvidence, seed: int) -> bool:
        observation, info = env.reset(seed=seed)
        ended = False
        while not ended:
            action = self.subject.policy.act(observation[None])[0]
            observation, _, terminated, truncated, info = env.step(action)
            ended = terminated or truncated
        return bool(info["success"])


def _replays(at_home: Successes | None) -> dict[int, Replays] | None:
    if at_home is None:
        return None
    return {episode: Replays(home=success) for episode, success in enumerate(at_home)}


def _returns(existing: Existing, spec: TaskPanel, matrix: Matrix) -> str:
    """The range of the policy's returns in one sentence."""
    row, home = existing.policy.policy_id, home_cell(existing.home)
    cells = [cell.name for cell in spec.columns()]
    means = {name: float(matrix.values(row, name, "return").mean()) for name in cells}
    low, high = min(means, key=lambda n: means[n]), max(means, key=lambda n: means[n])
    if means[low] == means[high]:
        return f"Its mean return is {means[home]:.1f} on each of them."
    return (
        f"Its mean return is {means[home]:.1f} at home, and between {means[low]:.1f} ({low}) and "
        f"{means[high]:.1f} ({high})."
    )


def _doubts(
    existing: Existing, spec: TaskPanel, directory: RunDirectory, matrix: Matrix
) -> list[str]:
    """Doubt where the policy is no better than random, or where success cannot fail."""
    home = home_cell(existing.home)
    own, chance = (
        matrix.values(row, home, "return")[0] for row in (existing.policy.policy_id, "random")
    )
    return [*doubts_of(existing, home, own, chance), *_survival_doubts(spec, directory)]


def _survival_doubts(spec: TaskPanel, directory: RunDirectory) -> list[str]:
    if spec.success_return is not None:
        return []
    records = EvidenceStore(directory.evidence)
    if records.query("SELECT record_id FROM records WHERE terminated LIMIT 1").num_rows:
        return []
    solved = spec.reward_threshold
    suggestion = "" if solved is None else f" (Gymnasium calls the task solved at {solved:g})"
    return [
        "no episode of any row ends before its time limit, so success, which is survival, tells "
        f"nothing here: compare returns, or give --success-return R{suggestion}"
    ]
