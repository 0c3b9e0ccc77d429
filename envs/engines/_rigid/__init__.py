"""A plant told to simulators of rigid bodies, in their formats, and checked against the plant."""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .agreement import PROBES, TOLERANCE, Array, check_agreement, mechanism_of
    from .bodies import HeldForce, RigidBodyEngine
    from .formats import (
        LEAST_INERTIA,
        LEAST_SHARE,
        MAPS,
        mass_matrix,
        mjcf,
        moment,
        stop_law,
        urdf,
    )
    from .lanes import LanesEngine
    from .warp import ROWS, WarpEngine, Worlds, constraint_solver, forces_at_rest
else:
    __getattr__, __dir__ = lazy_door(__name__)
