"""Policies as evaluation sees them: observations in, the deterministic action out.

`Policy` is what every policy offers, a trained network as well as a hand-made controller.
`MlpPolicy` is a trained feed-forward actor in NumPy alone, so that evaluating a policy needs
neither torch nor stable-baselines3 (SB3), and a worker process starts in a fraction of the time.
"""

from .actions import BoxActions, DiscreteActions
from .activations import ACTIVATIONS
from .interface import Policy
from .mlp_policy import MlpPolicy
from .observation_statistics import ObservationStatistics

__all__ = [
    "ACTIVATIONS",
    "BoxActions",
    "DiscreteActions",
    "MlpPolicy",
    "ObservationStatistics",
    "Policy",
]
