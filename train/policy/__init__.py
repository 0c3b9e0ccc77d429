"""Policies as evaluation sees them: observations in, the deterministic action out.

`Policy` is what every policy offers, a trained network as well as a hand-made controller.
`MlpPolicy` is a trained feed-forward actor in NumPy alone, so that evaluating a policy needs
neither torch nor stable-baselines3 (SB3), and a worker process starts in a fraction of the time.
"""

from integ_gym.train.policy.actions import BoxActions, DiscreteActions
from integ_gym.train.policy.activations import ACTIVATIONS
from integ_gym.train.policy.interface import Policy
from integ_gym.train.policy.mlp_policy import MlpPolicy
from integ_gym.train.policy.observation_statistics import ObservationStatistics

__all__ = [
    "ACTIVATIONS",
    "BoxActions",
    "DiscreteActions",
    "MlpPolicy",
    "ObservationStatistics",
    "Policy",
]
