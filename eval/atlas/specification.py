"""An atlas's specification: one panel at several limits of the control, over the least it takes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from integ_gym.envs import numerics
from integ_gym.envs.actuators import ServoPlant
from integ_gym.envs.environment import environment_setup
from integ_gym.envs.settings import Discretization

from ..panel.cells import SpecError
from ..panel.spec import PanelSpec, parse_spec, read_toml

WIDEST = 1e4
"""Largest limit of the control that is tried, as a multiple of the smallest."""


def control_argument(setup: Any) -> tuple[str, float]:
    """Name and value of the constructor argument that limits the control.

    Raises:
        SpecError: where no single one does.
    """
    task: Any = setup.task
    if isinstance(setup.plant, ServoPlant):
        raise SpecError("an atlas varies the limit of an effort; leave `actuator` out")
    limit = setup.largest_controls[0]
    for one in fields(task):
        value = getattr(task, one.name)
        if isinstance(value, float) and value == limit:
            doubled: Any = replace(task, **{one.name: 2.0 * value})
            if all(end == 2.0 * was for end, was in zip(_ends(doubled), _ends(task), strict=True)):
                return one.name, value
    raise SpecError(f"no argument of {type(task).__name__} alone limits the control")


def _ends(task: Any) -> list[float]:
    """Smallest and largest value of every control."""
    return [float(end) for ends in task.control_limits for end in ends]


def middle_start(setup: Any) -> npt.NDArray[np.float64]:
    """The middle of a task's starts, in state order, shape (n,)."""
    return np.array(setup.task.draw_start(_Middle(), setup.settings.start, {}), dtype=np.float64)


def critical_limit(
    env_id: str, environment: Mapping[str, Any], argument: str, at: Discretization
) -> float:
    """Smallest limit of the control with which a search reaches the goal's energy in time.

    Args:
        env_id: one of integ-gym's environments.
        environment: constructor arguments without the discretization.
        argument: the one that limits the control; what it is set to does not matter.
        at: discretization.

    Raises:
        SpecError: if the goal's energy is not reached, or the task names no goal at rest.
    """
    rest = {name: value for name, value in environment.items() if name != argument}
    return _critical_limit(env_id, tuple(sorted(rest.items())), at)


@lru_cache(maxsize=256)
def _critical_limit(env_id: str, given: tuple[tuple[str, Any], ...], at: Discretization) -> float:
    setup = environment_setup(env_id, {**dict(given), **at.arguments()})
    required = numerics.goal_energy(setup)
    if required is None:
        raise SpecError(f"{env_id} names no goal at rest; state `critical` under [atlas]")
    if required == 0.0:
        raise SpecError(f"{env_id}: the goal takes no energy there, so no least control is defined")
    high, start = abs(required), middle_start(setup)
    try:
        return numerics.critical_limit(
            setup, start, setup.settings.duration, high / WIDEST, high, tolerance=high * 1e-5
        )
    except ValueError as error:
        raise SpecError(f"{env_id} on {at.name}: {error}") from None


class _Middle:
    """Draws the middle of every range."""

    def uniform(self, low: Any = 0.0, high: Any = 1.0, size: Any = None) -> Any:
        """(low + high) / 2, shape of ``size`` or of the ends."""
        middle = 0.5 * (np.asarray(low) + np.asarray(high))
        return middle if size is None else np.broadcast_to(middle, size)


class _Axis(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """The table ``[atlas]``."""

    argument: str
    ratios: list[float]
    critical: float | None = None
    seeds_per_block: int = 16


@dataclass(frozen=True)
class Block:
    """What is run in one piece.

    Attributes:
        ratio: limit of the control over the critical one.
        limit: limit of the control, N m or N.
        panel: with the block's seeds.
    """

    ratio: float
    limit: float
    panel: PanelSpec

    @property
    def name(self) -> str:
        """Of its file and its run."""
        return f"{self.ratio:g}-seed{self.panel.seeds[0]}"


@dataclass(frozen=True)
class Atlas:
    """A panel that is run at several limits of the control, each a block.

    Attributes:
        panel: what all blocks have in common.
        argument: constructor argument that limits the control.
        ratios: its values over the critical one, ascending.
        seeds_per_block: training seeds that are run in one piece.
        stated: critical value where it is not searched for, N m or N.
    """

    panel: PanelSpec
    argument: str
    ratios: tuple[float, ...]
    seeds_per_block: int = 16
    stated: float | None = None

    @property
    def name(self) -> str:
        """Of the atlas."""
        return self.panel.name

    @cached_property
    def critical(self) -> float:
        """Smallest limit with which a search reaches the goal's energy in time on the truth.

        Raises:
            SpecError: where there is no truth, or the task names no goal at rest.
        """
        if self.stated is not None:
            return self.stated
        truth = self.panel.reference
        if truth is None:
            raise SpecError(f"{self.panel.env_id} has no truth; state `critical` under [atlas]")
        return critical_limit(self.panel.env_id, self.panel.environment, self.argument, truth)

    def blocks(self) -> tuple[Block, ...]:
        """All blocks: every ratio with the first seeds, then with the next."""
        seeds, size = self.panel.seeds, self.seeds_per_block
        return tuple(
            Block(
                ratio,
                limit := round(ratio * self.critical, 4),
                replace(
                    self.panel,
                    name=f"{self.name} at {ratio:g}",
                    environment={**self.panel.environment, self.argument: limit},
                    seeds=seeds[first : first + size],
                ),
            )
            for first in range(0, len(seeds), size)
            for ratio in self.ratios
        )


def read_atlas(path: Path) -> Atlas:
    """Read an atlas from a TOML file: a panel's specification with a table ``[atlas]``.

    Raises:
        SpecError: if the file cannot be read, or is no valid specification.
    """
    data = dict(read_toml(path))
    try:
        axis = _read_axis(data.pop("atlas", None))
    except (msgspec.ValidationError, SpecError) as error:
        raise SpecError(f"{path}: {error}; docs/reference/atlas.md has the format") from None
    panel = parse_spec(data, str(path))
    if any(home.control_period != panel.control_period for home in panel.trained_on()):
        raise SpecError(f"{path}: an atlas has one control period; leave it out of `train`")
    name, _ = control_argument(panel.nominal)
    if axis.argument != name:
        raise SpecError(f"{path}: `{axis.argument}` does not limit the control; `{name}` does")
    ratios = tuple(axis.ratios)
    return Atlas(panel, axis.argument, ratios, axis.seeds_per_block, axis.critical)


def _read_axis(table: object) -> _Axis:
    if table is None:
        raise SpecError("it has no table [atlas]")
    axis = msgspec.convert(table, _Axis)
    if not axis.ratios or min(axis.ratios) <= 0.0 or sorted(set(axis.ratios)) != axis.ratios:
        raise SpecError(f"`ratios` must be above 0 and ascend, got {axis.ratios}")
    if axis.seeds_per_block < 1:
        raise SpecError(f"`seeds_per_block` must be 1 or above, got {axis.seeds_per_block}")
    return axis
