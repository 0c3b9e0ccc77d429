"""What evidence records of a robot beside state and controls: command, forces, contacts, solver."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import hypot, nan
from typing import Any, NamedTuple

import numpy as np

from ..foreign import Further
from ..mujoco_ledger import Contacts
from ..ops.ops import Array


class Look(NamedTuple):
    """What is looked up of a robot's contacts and solver at one instant."""

    residual: float
    contacts: int
    """How many; without any, all below is left out."""
    forces: Any = None
    geoms: Any = None
    points: Any = None
    frames: Any = None


class OneOfOne:
    """Fields of an `MjData` with a first axis, as many robots have them."""

    def __init__(self, data: Any) -> None:
        self._data = data

    def __getattr__(self, name: str) -> Array:
        field: Array = getattr(self._data, name)[None]
        return field


class Figures:
    """Figures of robots at the end of a control step, where `mj_forward` was called.

    Feet are the bodies without others below them that may touch what stands still. Forces in a
    contact are MuJoCo's; its slip is the speed along its plane of one body's point against the
    other's.

    Args:
        mujoco: the module.
        model: compiled model.
        commands: names of what an episode is commanded.
        measured: whether these are measured, too.
        actuators: name of each.

    Attributes:
        columns: names, units and meanings.
    """

    def __init__(
        self,
        mujoco: Any,
        model: Any,
        commands: Iterable[str],
        measured: bool,
        actuators: Iterable[str],
    ) -> None:
        self._mujoco, self._model = mujoco, model
        self._kept = int(mujoco.mjNSOLVER)
        self._forces, self._rows = np.zeros((0, 6)), [np.zeros(6)]
        feet = feet_of(model)
        self._feet = len(feet)
        self._places = np.full(model.nbody, -1)
        self._places[[*feet.values()]] = np.arange(1, len(feet) + 1)
        self._root = np.array(model.body_rootid)
        self._body = np.array(model.geom_bodyid)
        wanted = [Further(f"command_{name}", "", "what is commanded") for name in commands]
        shown = [Further(f"measured_{name}", "", "the same, measured") for name in commands]
        parts = (
            ("normal_force", "N", "sum of the normal contact forces"),
            ("tangential_force", "N", "sum of the magnitudes of the tangential ones"),
            ("slip_speed", "m/s", "fastest slip of a contact"),
        )
        self.columns: tuple[Further, ...] = (
            *wanted,
            *(shown if measured else ()),
            *(Further(f"{name}_force", "N, N m", "force of the actuator") for name in actuators),
            *(
                Further(f"{owner}{name}", unit, f"{words}{', of this foot' if owner else ''}")
                for owner in ("contact_", *(f"{name}_" for name in feet))
                for name, unit, words in parts
            ),
            Further("solver_residual", "1", "scaled gradient after the solver's last iteration"),
        )

    def look(self, own: Contacts) -> Look:
        """What the figures of one robot are made of.

        Args:
            own: contacts of its data, where `mj_forward` was called.
        """
        data, count = own.data, own.data.ncon
        residual = self._residual(own)
        if not count:
            return Look(residual, 0)
        if count > len(self._forces):
            self._forces = np.zeros((2 * count, 6))
            self._rows = [*self._forces]
        contact_force, model, rows = self._mujoco.mj_contactForce, self._model, self._rows
        for place in range(count):
            contact_force(model, data, place, rows[place])
        seen = own[count]
        copies = seen["geom"].copy(), seen["pos"].copy(), seen["frame"].copy()
        return Look(residual, count, self._forces[:count].copy(), *copies)

    def read(self, looks: Sequence[Look], robots: Any, *leading: Array) -> Array:
        """The figures of some robots in the order of :attr:`columns`, shape (robots, columns).

        Args:
            looks: at each.
            robots: fields of their data, of shape (robots, …).
            leading: command, and what is measured of it, shape (robots, numbers).
        """
        residuals = np.array([[look.residual] for look in looks])
        contacts = self._contacts(looks, robots)
        return np.concatenate([*leading, robots.actuator_force, contacts, residuals], axis=1)

    def _contacts(self, looks: Sequence[Look], robots: Any) -> Array:
        """Normal and tangential force, N, and slip, m/s: of all contacts, then of each foot."""
        rows = np.zeros((len(looks), self._feet + 1, 3))
        touching = [look[2:] for look in looks if look.contacts]
        if not touching:
            return rows.reshape(len(looks), -1)
        forces, pairs, points, frames = map(np.concatenate, zip(*touching, strict=True))
        counts = [look.contacts for look in looks]
        of_lane = np.repeat(np.arange(len(looks)), counts)[:, None]
        bodies = self._body[pairs]
        arm = points[:, None] - robots.subtree_com[of_lane, self._root[bodies]]
        moving = robots.cvel[of_lane, bodies]
        spin, speed = moving[..., :3], moving[..., 3:]
        speeds = speed + spin[..., [1, 2, 0]] * arm[..., [2, 0, 1]]
        speeds -= spin[..., [2, 0, 1]] * arm[..., [1, 2, 0]]
        planes = frames.reshape(-1, 3, 3)[:, 1:]
        slips = np.einsum("kij,kj->ki", planes, speeds[:, 1] - speeds[:, 0])
        normal = forces[:, 0]
        columns = normal, _lengths(forces[:, 1:3]), _lengths(slips)
        pressed = normal > 0.0
        # all contacts of a lane, and those of each foot; what touches none is counted at the end
        places = np.append(np.zeros((len(pairs), 1), np.int64), self._places[bodies], axis=1)
        places = np.where(places < 0, rows[..., 0].size, of_lane * (self._feet + 1) + places)
        into, flat = places[pressed].ravel(), rows.reshape(-1, 3)
        for kind, values in enumerate(columns):
            each = np.repeat(values[pressed], 3)
            if kind < 2:
                flat[:, kind] = np.bincount(into, each, len(flat) + 1)[:-1]
            else:
                most = np.zeros(len(flat) + 1)
                np.maximum.at(most, into, each)
                flat[:, kind] = most[:-1]
        return rows.reshape(len(looks), -1)

    def _residual(self, own: Contacts) -> float:
        """NaN where the solver was content before its first iteration."""
        data, kept = own.data, self._kept
        if not data.nefc:
            return 0.0
        if data.nisland <= 1:
            used = int(data.solver_niter[0])
            return float(own.gradients[min(used, kept) - 1]) if used else nan
        counts = data.solver_niter[: data.nisland].tolist()
        last = [kept * island + min(n, kept) - 1 for island, n in enumerate(counts) if n]
        return max((float(own.gradients[place]) for place in last), default=nan)


def _lengths(vectors: Array) -> Array:
    """Of vectors of two components, shape (n, 2)."""
    return np.array([*map(hypot, *vectors.T.tolist())])


def feet_of(model: Any) -> dict[str, int]:
    """Bodies without others below them that may touch what stands still, ascending.

    By their names, or by number where one has none.
    """
    body, kind, affinity = model.geom_bodyid, model.geom_contype, model.geom_conaffinity
    still = np.flatnonzero(model.body_weldid[body] == 0)
    touching = [
        geom
        for geom in range(model.ngeom)
        if ((kind[geom] & affinity[still]) | (affinity[geom] & kind[still])).any()
    ]
    pairs = np.stack([model.pair_geom1, model.pair_geom2], axis=1)
    touching += pairs[np.isin(pairs, still).any(axis=1)].ravel().tolist()
    parents = set(model.body_parentid.tolist())
    feet = sorted(
        own for own in set(body[touching].tolist()) if model.body_weldid[own] and own not in parents
    )
    return {model.body(own).name or f"body{own}": own for own in feet}
