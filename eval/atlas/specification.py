"""An atlas's specification: one panel at several limits of the control."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import msgspec

from ..panel.cells import SpecError
from ..panel.spec import PanelSpec, parse_spec, read_toml
from .limits import control_argument, critical_limit


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
            self._block(ratio, seeds[first : first + size])
            for first in range(0, len(seeds), size)
            for ratio in self.ratios
        )

    def _block(self, ratio: float, seeds: tuple[int, ...]) -> Block:
        limit = round(ratio * self.critical, 4)
        environment = {**self.panel.environment, self.argument: limit}
        name = f"{self.name} at {ratio:g}"
        panel = replace(self.panel, name=name, environment=environment, seeds=seeds)
        return Block(ratio, limit, panel)


def read_atlas(path: Path) -> Atlas:
    """Read an atlas from a TOML file: a panel's specification with a table ``[atlas]``.

    Raises:
        SpecError: if the file cannot be read, or is no valid specification.
    """
    data = dict(read_toml(path))
    try:
        axis = _axis(data.pop("atlas", None))
    except (msgspec.ValidationError, SpecError) as error:
        raise SpecError(f"{path}: {error}; docs/reference/atlas.md has the format") from None
    panel = parse_spec(data, str(path))
    name, _ = control_argument(panel.nominal)
    if axis.argument != name:
        raise SpecError(f"{path}: `{axis.argument}` does not limit the control; `{name}` does")
    return Atlas(
        panel=panel,
        argument=axis.argument,
        ratios=tuple(axis.ratios),
        seeds_per_block=axis.seeds_per_block,
        stated=axis.critical,
    )


def _axis(table: object) -> _Axis:
    if table is None:
        raise SpecError("it has no table [atlas]")
    axis = msgspec.convert(table, _Axis)
    if not axis.ratios or min(axis.ratios) <= 0.0 or sorted(set(axis.ratios)) != axis.ratios:
        raise SpecError(f"`ratios` must be above 0 and ascend, got {axis.ratios}")
    if axis.seeds_per_block < 1:
        raise SpecError(f"`seeds_per_block` must be 1 or above, got {axis.seeds_per_block}")
    return axis
