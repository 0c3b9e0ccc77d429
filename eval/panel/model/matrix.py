"""A panel's matrix: its rows, its cells, and what each row did in each cell."""

from __future__ import annotations

from typing import Literal, TypeAlias

import msgspec

from ...verdict import Achievability, CellRole, ReferenceClass
from .part import Estimate, Part

RowKind: TypeAlias = Literal["trained", "given", "baseline"]
"""Trained by the panel, given to it, or a baseline that nobody trained."""

CellKind: TypeAlias = Literal["grid", "reference", "perturbation", "ladder"]
"""Of the grid; the truth; with a changed plant or delay; the control period follows the step."""


class Policy(Part, frozen=True, kw_only=True):
    """One policy of a row.

    Attributes:
        id: name of the policy in the evidence, `policy_id`.
        seed: training seed; null where it is not known.
        hash: hash of the policy's content; null for a baseline of an evaluation.
        file: path of its file beside ``panel.json``; null for a baseline.
    """

    id: str
    seed: int | None = None
    hash: str | None = None
    file: str | None = None


class Row(Part, frozen=True, kw_only=True):
    """Policies of one training discretization or mixture, one for each training seed.

    Attributes:
        name: name of the row, unique.
        kind: `trained`, `given` or `baseline`.
        home: name of the cell that it was trained in; null without one, or of a mixture.
        shares: share of each cell, by name, that its training drew from; empty for a baseline.
        integrator: integrator of its home; null without one, or of a mixture.
        dt: integration step of its home, s; null without one, or of a mixture.
        control_period: time between two decisions in training, s; null for a baseline.
        seeds: how many policies it has.
        policies: its policies.
        home_success: success rate at home, in [0, 1]; null without a home.
        learned: whether home success is at least 0.5; null without a home.
        training_steps: decisions that each policy was trained for; null where it was not trained.
    """

    name: str
    kind: RowKind
    home: str | None
    shares: dict[str, float]
    integrator: str | None
    dt: float | None
    control_period: float | None
    seeds: int
    policies: tuple[Policy, ...]
    home_success: Estimate | None
    learned: bool | None
    training_steps: int | None

    @property
    def baseline(self) -> bool:
        """Whether nobody trained it."""
        return self.kind == "baseline"

    @property
    def mixed(self) -> bool:
        """Whether it was trained on a mixture of discretizations."""
        return len(self.shares) > 1


class AppliedDiscretization(Part, frozen=True, kw_only=True):
    """What the environments of a cell really did, read back from those that were made.

    Attributes:
        engine: what advanced the plant.
        engine_version: its version; null where it tells none.
        integrator: integrator, as the engine calls it.
        dt: integration step, s.
        substeps: integration steps in a control period.
        control_period: time between two decisions, s.
    """

    engine: str
    engine_version: str | None
    integrator: str
    dt: float
    substeps: int
    control_period: float


class Cell(Part, frozen=True, kw_only=True):
    """One discretization in which policies were evaluated.

    Attributes:
        name: name of the cell, unique.
        engine: `native`, or the simulator that advances the plant.
        integrator: integrator, as the engine calls it.
        dt: integration step, s.
        control_period: time between two decisions, s.
        kind: `grid`, `reference`, `perturbation` or `ladder`.
        perturbation: name of the change of the plant or its delays; null without one.
        role: `reference` or `quarter_step` where the cell decides a comparison of policies.
        applied: what its records tell of the environments; null without records.
        achievability: `achievable`, `too_slow` (within two horizons alone), `unachievable` or
            `undecided`; null where it was not asked.
        achievability_reason: why, in one sentence with numbers.
    """

    name: str
    engine: str
    integrator: str
    dt: float
    control_period: float
    kind: CellKind
    perturbation: str | None
    role: CellRole | None
    applied: AppliedDiscretization | None = None
    achievability: Achievability | None = None
    achievability_reason: str | None = None

    @property
    def reference(self) -> bool:
        """Whether this is the truth column."""
        return self.perturbation is None and "reference" in (self.kind, self.role)

    @property
    def scheme(self) -> str:
        """Integrator, and the engine where it is not ours."""
        return self.integrator if self.engine == "native" else f"{self.engine} {self.integrator}"

    @property
    def plain(self) -> bool:
        """Whether the plant and its delays are those of the spec."""
        return self.perturbation is None and self.kind != "perturbation"


class Entry(Part, frozen=True, kw_only=True):
    """What one row did in one cell.

    Attributes:
        row: name of the row.
        cell: name of the cell.
        episodes: how many episodes, over all policies of the row.
        success: success rate, in [0, 1].
        success_by_seed: success rate of each policy, shape (seeds,).
        recovered: success rate within one horizon or two, in [0, 1].
        returns: interquartile mean of the returns, the plain mean where policies were given, as
            published tables have it; null where one of them is not finite; called
            ``return`` in the file.
        time_to_success: time to success, s, of the episodes that succeed; null without one.
        time_to_success_episodes: how many episodes succeed.
        energy_residual: sum of the energy residual over an episode, J; null where not known.
        energy_residual_abs: sum of the residual's sizes, J; null where not known.
        numerics_share: of the energy that successful episodes gain until they first reach the
            goal, the share that numerical error put in; negative where it took some out; null
            where nothing is gained or the residual is not known.
        diverged: episodes that the simulation did not survive.
        not_converged: episodes in which the solver missed its tolerance.
        home_drop: success at home minus success here; null at home and without one. The next
            three add up to it.
        difficulty: what policies trained here and the hand-made controller do not reach either.
        deadline: what is won back within a second horizon.
        overfitting: the rest.
        tail: share of the seeds that lose more than 0.5 of success; null at home and without one.
        worst_policy: id of the policy that loses most; null likewise.
        worst_loss: what it loses.
        transfer_gap: success of the policies trained here minus that of these; null without any.
        reference_class: the cell's pass or fail beside the reference's; null where the reference
            has another plant or control period, and in cells that cannot be solved in time.
        labels: episodes by failure label; `none` are those that succeed.
        file: evidence files that hold the records, beside ``panel.json``.
        query: command that lists the records.
    """

    row: str
    cell: str
    episodes: int
    success: Estimate
    success_by_seed: tuple[float, ...]
    recovered: Estimate
    returns: Estimate | None = msgspec.field(name="return")
    time_to_success: Estimate | None
    time_to_success_episodes: int
    energy_residual: Estimate | None
    energy_residual_abs: Estimate | None
    numerics_share: Estimate | None = None
    diverged: int
    not_converged: int
    home_drop: Estimate | None
    difficulty: Estimate | None
    deadline: Estimate | None
    overfitting: Estimate | None
    tail: Estimate | None = None
    worst_policy: str | None = None
    worst_loss: float | None = None
    transfer_gap: Estimate | None
    reference_class: ReferenceClass | None
    labels: dict[str, int]
    file: tuple[str, ...]
    query: str

    @property
    def contradicted(self) -> bool:
        """Whether the reference contradicts its pass or fail."""
        return self.reference_class in ("false_pass", "false_fail")
