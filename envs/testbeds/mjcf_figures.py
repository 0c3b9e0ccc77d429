"""What evidence tells of a robot beside state and controls: command, forces, contacts, solver."""

from __future__ import annotations

from collections.abc import Iterable
from math import hypot, nan
from typing import Any

import numpy as np
import numpy.typing as npt

from ..foreign import Further

Array = npt.NDArray[Any]


class Figures:
    """Figures of a robot at the end of a control step, where `mj_forward` was called.

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
        self._force = np.zeros(6)
        self._kept = int(mujoco.mjNSOLVER)
        feet = feet_of(model)
        self._rows = {body: place for place, body in enumerate(feet.values(), 1)}
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

    def read(self, data: Any, *told: Array) -> Array:
        """The figures in the order of :attr:`columns`.

        Args:
            data: where `mj_forward` was called.
            told: command, and what is measured of it.
        """
        contacts = self._contacts(data) if data.ncon else np.zeros(3 * len(self._rows) + 3)
        return np.concatenate([*told, data.actuator_force, contacts, [self._residual(data)]])

    def _contacts(self, data: Any) -> Array:
        """Normal and tangential force, N, and slip, m/s: of all contacts, then of each foot."""
        contact, places = data.contact, self._rows
        bodies = self._body[contact.geom]
        arm = contact.pos[:, None] - data.subtree_com[self._root[bodies]]
        moving = data.cvel[bodies]
        spin, speed = moving[..., :3], moving[..., 3:]
        points = speed + spin[..., [1, 2, 0]] * arm[..., [2, 0, 1]]
        points -= spin[..., [2, 0, 1]] * arm[..., [1, 2, 0]]
        frame = contact.frame.reshape(-1, 3, 3)
        slips = np.einsum("kij,kj->ki", frame[:, 1:], points[:, 1] - points[:, 0]).tolist()
        rows = [[0.0, 0.0, 0.0] for _ in range(len(places) + 1)]
        for place, (pair, slip) in enumerate(zip(bodies.tolist(), slips, strict=True)):
            self._mujoco.mj_contactForce(self._model, data, place, self._force)
            normal, *tangents = self._force[:3].tolist()
            if normal > 0.0:
                for row in (0, *(places[body] for body in pair if body in places)):
                    own = rows[row]
                    own[0] += normal
                    own[1] += hypot(*tangents)
                    own[2] = max(own[2], hypot(*slip))
        return np.ravel(rows)

    def _residual(self, data: Any) -> float:
        """NaN where the solver was content before its first iteration."""
        if not data.nefc:
            return 0.0
        counts, kept = data.solver_niter[: max(1, data.nisland)].tolist(), self._kept
        last = [kept * island + min(n, kept) - 1 for island, n in enumerate(counts) if n]
        return max((float(data.solver[place].gradient) for place in last), default=nan)


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
