"""A plant told to simulators of rigid bodies, in their formats, and checked against the plant."""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .agreement import PROBES, TOLERANCE, check_agreement
    from .bodies import Array, HeldForce, RigidBodyEngine, mechanism_of
    from .lanes import LanesEngine
    from .mjcf_text import LEAST_INERTIA, MAPS, mjcf
    from .moments import LEAST_SHARE, moment
    from .urdf_text import urdf
else:
    __getattr__, __dir__ = lazy_door(__name__)
