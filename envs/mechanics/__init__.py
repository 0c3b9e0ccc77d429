"""What plants are put together with: forces of contact and friction, rigid links, the system.

Knows mechanics in general and no plant, integrator or engine by name.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .contact import Stops, stops_at
    from .friction import Friction, friction_of
    from .mechanism import Link, Mechanism
    from .system import PlantSystem
else:
    __getattr__, __dir__ = lazy_door(__name__)
