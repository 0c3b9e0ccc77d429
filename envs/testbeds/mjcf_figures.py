"""What evidence tells of a robot beside state and controls: command, forces, contacts, solver."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import hypot, nan
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..foreign import Further
from ..mujoco_ledger import Contacts

Array = npt.NDArray[Any]


class Look(NamedTuple):
    """What the figures of a robot at one instant are made of, as MuJoCo has it."""

    actuator_force: Array
    residual: float
    contacts: int
    """How many, without which all below is left out."""
    forces: Any = None
    geoms: Any = None
    points: Any = None
    frames: Any = None
    subtree_com: Any = None
    cvel: Any = None


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
        force, residual = data.actuator_force.copy(), self._residual(own)
        if not count:
            return Look(force, residual, 0)
        forces = np.zeros((count, 6))
        for place, row in enumerate(forces):
            self._mujoco.mj_contactForce(self._model, data, place, row)
        pairs, points, frames = (own[count][name].copy() for name in ("geom", "pos", "frame"))
        of_bodies = data.subtree_com.copy(), data.cvel.copy()
        return Look(force, residual, count, forces, pairs, points, frames, *of_bodies)

    def read(self, looks: Sequence[Look], *told: Array) -> Array:
        """The figures of some robots in the order of :attr:`columns`, shape (robots, columns).

        Args:
            looks: at each.
            told: command, and what is measured of it, shape (robots, numbers).
        """
        forces = np.array([look.actuator_force for look in looks])
        residuals = np.array([[look.residual] for look in looks])
        return np.concatenate([*told, forces, self._contacts(looks), residuals], axis=1)

    def _contacts(self, looks: Sequence[Look]) -> Array:
        """Normal and tangential force, N, and slip, m/s: of all contacts, then of each foot."""
        counts = [look.contacts for look in looks]
        rows = np.zeros((len(looks), self._feet + 1, 3))
        touching = [look[3:] for look in looks if look.contacts]
        if not touching:
            return rows.reshape(len(looks), -1)
        forces, pairs, points, frames, centres, moving = map(
            np.concatenate, zip(*touching, strict=True)
        )
        first = np.cumsum([0, *(count > 0 for count in counts)])[:-1] * len(self._root)
        first = np.repeat(first, counts)[:, None]
        bodies = self._body[pairs]
        of_lane = np.repeat(np.arange(len(looks)), counts)[:, None]
        arm = points[:, None] - centres[first + self._root[bodies]]
        moving = moving[first + bodies]
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
        counts = data.solver_niter[: max(1, data.nisland)].tolist()
        last = [kept * island + min(n, kept) - 1 for island, n in enumerate(counts) if n]
        return max((float(own.gradients[place]) for place in last), default=nan)


def _lengths(vectors: Array) -> Array:
    """Of vectors of two components, shape (n, 2)."""
    return np.array([hypot(*vector) for vector in vectors.tolist()])


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
