"""What a policy loses on the truth by the discretization it learned in, measured by a small panel.

A few training seeds learn in one discretization and are judged there, at half and at a quarter of
its step, and on the truth. The number of seeds grows until the interval of the loss is narrow.
"""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Literal

import msgspec

from integ_gym.envs.environment import is_integ_environment
from integ_gym.envs.settings import DISCRETIZATION, NATIVE, Discretization, Settings
from integ_gym.envs.testbeds.making import find_testbed
from integ_gym.support.errors import InputError
from integ_gym.support.optional import require
from integ_gym.support.parameters import check_values

from .panel.cells import SpecError, file_name
from .panel.conclusions import contract_reason, finding_of, is_small
from .panel.plan import with_seed_count
from .panel.result import Panel
from .panel.run import check_spec, run_panel
from .panel.run_directory import MANIFEST, read_manifest
from .panel.spec import PanelSpec, check_parts
from .statistics import Estimate
from .verdict import LEARNED, Achievability, checked_loss

NARROW: Final = 0.2
"""Half-width of the interval at which no more seeds are trained."""

FIRST_SEEDS, MOST_SEEDS, SEEDS_TOGETHER = 12, 32, 4
"""Seeds that are trained first, at most, and in multiples of which their number grows."""

EPISODES = 20
"""Starts of every seed, its own and the same in every cell."""

_SWING_UP = {
    "batch_size": 512,
    "gae_lambda": 0.9,
    "learning_rate": 2e-3,
    "learning_rate_end": 0.0,
}

TRAINING: Final[Mapping[str, Mapping[str, Any]]] = {
    "IntegPendulum-v0": {"total_steps": 300_000, **_SWING_UP},
    "IntegCartPoleSwingUp-v0": {"total_steps": 800_000, **_SWING_UP},
    "IntegElasticPendulum-v0": {"total_steps": 200_000, **_SWING_UP},
}
"""Hyperparameters where they are not the trainer's own, by environment."""


@dataclass(frozen=True)
class CheckedCell:
    """What the policies did in one discretization.

    Attributes:
        name: of the cell.
        success: rate over seeds and starts, in [0, 1].
        recovered: the same within one horizon or two.
        loss: success at home less that, with its interval; None at home.
        achievability: whether the cell can be solved in time; None where it was not asked.
        contract: how it differs from home before any integration; empty where it does not.
    """

    name: str
    success: float
    recovered: float
    loss: Estimate | None
    achievability: Achievability | None = None
    contract: str = ""


@dataclass(frozen=True)
class Check:
    """What policies lose by the discretization that they learned in.

    Attributes:
        panel: what was run, as ``panel.json`` holds it.
        directory: of the run.
        seeds: training seeds.
        starts: of each seed.
        home: where they learned.
        truth: what they are held against; without a reference the finest step.
        exact: whether that is the reference.
        cells: home first, then finer steps, the truth last.
    """

    panel: Panel
    directory: Path
    seeds: int
    starts: int
    home: CheckedCell
    truth: CheckedCell
    exact: bool
    cells: tuple[CheckedCell, ...]

    @property
    def loss(self) -> Estimate:
        """Success at home less success on the truth, with its interval over seeds and starts."""
        assert self.truth.loss is not None
        return self.truth.loss

    @property
    def half_width(self) -> float:
        """Of the interval of the loss."""
        low, high = self.loss.ends
        return 0.5 * (high - low)

    @property
    def learned(self) -> bool:
        """Whether the task was learned at home."""
        return self.home.success >= LEARNED

    @property
    def cause(self) -> Literal["yes", "no", "undecided"]:
        """Whether the discretization costs success.

        `yes` where the interval of the loss is above 0 and reaches beyond 0.1; `no` where the loss
        is practically equal, a gain, or below 0.2 and not shown. `undecided` otherwise, and where
        too little was learned, the truth is not known to be solvable in time, or it differs from
        home before any integration.
        """
        finding = finding_of(self.panel)
        status = "undecided" if finding is None else finding.status
        if status == "cause":
            return "yes"
        small = status == "undecided" and is_small(self.loss)
        return "no" if small or status in ("not_cause", "gained") else "undecided"

    @property
    def seconds_per_seed(self) -> float:
        """Time that one more seed takes with as many workers, s."""
        return self.panel.cost.wall_seconds / self.seeds

    def half_width_with(self, seeds: int) -> float:
        """Of the interval that so many seeds in all are expected to give."""
        return self.half_width * math.sqrt((self.seeds + 1) / (seeds + 1))

    def __str__(self) -> str:
        """The answer in one line, as the page has it."""
        return self.panel.headline


def check(
    env_id: str = "IntegPendulum-v0",
    *,
    integrator: str,
    dt: float,
    control_period: float | None = None,
    engine: str | None = None,
    environment: Mapping[str, Any] | None = None,
    training: Mapping[str, Any] | None = None,
    trainer: str | None = None,
    seeds: int | None = None,
    out: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    progress: bool = True,
    command: str = "integ_gym.check",
) -> Check:
    """Measure what policies lose on the truth by the discretization that they learn in.

    Args:
        env_id: one of integ-gym's environments, a MuJoCo task of Gymnasium's, or a testbed.
        integrator: on which policies learn.
        dt: integration step with which they learn, s.
        control_period: time between two decisions, s; by default the task's only one, or ``dt``.
        engine: of the integrator; by default the task's own.
        environment: other constructor arguments.
        training: hyperparameters that differ from the check's own, such as ``total_steps``.
        trainer: ``"fleet"`` or ``"sb3"``; by default the fleet where it can train the task.
        seeds: how many train; by default 12, and up to 32 until the interval's half-width is 0.2.
        out: directory of the run; by default one in ``runs/check``, named after what is checked.
            What is finished there is not run again.
        workers: processes; by default one per core.
        progress: show a bar with the remaining time on stderr.
        command: how to run this again, for the page.

    Raises:
        SpecError, TypeError, ValueError: for what cannot be run, before anything is.
        PanelError, TrainingError: if a unit of work fails; what was finished stays.
        ModuleNotFoundError: if an extra is missing, with the command that installs it.
    """
    require("report", "evidence")
    if given := [name for name in DISCRETIZATION if name in (environment or {})]:
        raise InputError(f"`environment` gives `{given[0]}`; give it as an argument of its own")
    check_values(Settings, {"dt": dt, "control_period": control_period})
    testbed = find_testbed(env_id, environment or {})
    period = testbed.control_period if control_period is None else control_period
    own = testbed.home.engine if engine is None else engine
    home = Discretization(integrator, dt, dt if period is None else period, own)
    if home.integrator == "reference" and home.engine == NATIVE:
        raise InputError(
            "`reference` is the truth itself, so nothing is lost with it; check another integrator"
        )
    spec = specify(env_id, home, environment or {}, training or {}, trainer)
    if out is None:  # named after all that the run depends on but the number of seeds
        plain = {name: value for name, value in spec.to_json().items() if name != "seeds"}
        digest = hashlib.sha256(msgspec.json.encode(plain, order="sorted")).hexdigest()[:8]
        out = Path("runs") / "check" / f"{file_name(f'{spec.env_id}-{home.name}')}-{digest}"
    place = Path(out)
    first = FIRST_SEEDS if seeds is None else seeds
    if seeds is None and (place / MANIFEST).exists():
        asked = read_manifest(place / MANIFEST)["specification"].get("seeds", ())
        first = max(first, len(asked))  # that a run there was last asked for
    spec = with_seed_count(spec, first)
    while True:
        panel = run_panel(
            spec, place, workers=workers, progress=progress, command=command, staged=False
        )
        found = check_of(panel, place, home)
        wanted = next_seed_count(found.seeds, found.half_width)
        if seeds is not None or wanted == found.seeds:
            return found
        spec = with_seed_count(spec, wanted)


def specify(
    env_id: str,
    home: Discretization,
    environment: Mapping[str, Any],
    training: Mapping[str, Any],
    trainer: str | None,
) -> PanelSpec:
    """The panel with its first seeds, checked; trained by the fleet where that can."""
    own = "fleet" if is_integ_environment(env_id) else "sb3"
    spec = PanelSpec(
        name=f"check {home.name}",
        question=f"What does a policy that learns on {home.name} lose on the truth?",
        env_id=env_id,
        control_period=home.control_period,
        environment=dict(environment),
        training={**TRAINING.get(env_id, {}), **training},
        trainer=own if trainer is None else trainer,
        train=(home,),
        grid=tuple(replace(home, dt=home.dt / parts) for parts in (1, 2, 4)),
        seeds=tuple(range(FIRST_SEEDS)),
        ladder=False,
        episodes=EPISODES,
        trace_every=4,
        check=True,
    )
    check_parts(spec)
    try:
        check_spec(spec)
    except SpecError:
        if trainer is not None or spec.trainer != "fleet":
            raise
        spec = replace(spec, trainer="sb3")
        check_spec(spec)
    return spec


def check_of(panel: Panel, place: Path, home: Discretization) -> Check:
    """What a panel of one row tells: home first, the truth last."""
    row = panel.rows[0]
    at_home = panel.entry(row.name, home.name)
    assert at_home is not None
    cells = []
    for cell in sorted(panel.cells, key=lambda cell: (cell.reference, -cell.dt)):
        entry = panel.entry(row.name, cell.name)
        assert entry is not None
        success, recovered, lost = entry.success.estimate, entry.recovered.estimate, None
        if cell.name != home.name:
            lost = checked_loss(at_home.success_by_seed, entry.success_by_seed)
        differs = contract_reason(panel, row.name, cell.name)
        cells.append(CheckedCell(cell.name, success, recovered, lost, cell.achievability, differs))
    exact, starts = panel.truth is not None, panel.spec["episodes"]
    return Check(panel, place, row.seeds, starts, cells[0], cells[-1], exact, tuple(cells))


def next_seed_count(seeds: int, half_width: float) -> int:
    """How many seeds to go on with: the same where the interval is narrow, or they are enough."""
    if half_width <= NARROW or seeds >= MOST_SEEDS:
        return seeds
    needed = math.ceil(seeds * (half_width / NARROW) ** 2 / SEEDS_TOGETHER) * SEEDS_TOGETHER
    return min(MOST_SEEDS, max(needed, seeds + SEEDS_TOGETHER))
