"""Policies as evaluation sees them: observations in, the deterministic action out.

Knows networks as arrays; how they were trained or stored is not its business.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .actions import BoxActions, DiscreteActions, spread
    from .arrays import ActionArray, FloatArray
    from .called_policy import CalledPolicy, behaviour_hash
    from .interface import Policy
    from .mlp_policy import MOST, MlpPolicy
    from .network import ACTIVATIONS, Layer
    from .observation_statistics import ObservationStatistics
    from .stack import PolicyStack
else:
    __getattr__, __dir__ = lazy_door(__name__)
