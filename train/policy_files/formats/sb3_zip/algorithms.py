"""Policy classes of stable-baselines3 and sb3-contrib: where each keeps its deterministic actor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ...error import RETRAIN, PolicyFileError

SHARED = "mlp_extractor.shared_net"
"""Layers that actor and critic have in common, in files of before 1.8."""

_OFF_POLICY = ("critic.", "critic_target.")


@dataclass(frozen=True)
class Actor:
    """Where a policy class keeps its actor, and what it defaults to.

    Attributes:
        algorithms: that have it.
        hidden: name of the network of hidden layers in the state dict; each is followed by an
            activation.
        last: name of the last layer; None where it is the network's own last.
        unused: beginnings of the names of weights that decide no deterministic action.
        activation: default, the name of the torch class.
        sizes: default sizes of the hidden layers.
        squash: whether its actions always pass through tanh; None: as `squash_output` says.
        discrete: whether it chooses among a `Discrete` space; None: either.
        quantiles: default number of quantiles, whose mean is an action's value; 0: none.
    """

    algorithms: tuple[str, ...]
    hidden: str
    last: str | None
    unused: tuple[str, ...]
    activation: str = "ReLU"
    sizes: tuple[int, ...] = (256, 256)
    squash: bool | None = True
    discrete: bool | None = False
    quantiles: int = 0

    def names(self, shared: int, own: int, gsde: bool) -> Sequence[str]:
        """Names of the layers, input first.

        Args:
            shared: number of layers that actor and critic have in common.
            own: number of the actor's own hidden layers.
            gsde: whether a limit of gSDE's mean follows the last.
        """
        hidden = [f"{SHARED}.{2 * k}" for k in range(shared)]
        hidden += [f"{self.hidden}.{2 * k}" for k in range(own)]
        if self.last is None:
            return [*hidden, f"{self.hidden}.{2 * own}"]
        return [*hidden, f"{self.last}.0" if gsde else self.last]


_GAUSSIAN = {
    "hidden": "actor.latent_pi",
    "last": "actor.mu",
    "unused": (*_OFF_POLICY, "actor.log_std"),
}

ACTORS = {
    ("stable_baselines3.common.policies", "ActorCriticPolicy"): Actor(
        ("PPO", "A2C", "TRPO"),
        hidden="mlp_extractor.policy_net",
        last="action_net",
        unused=("mlp_extractor.value_net.", "value_net.", "log_std"),
        activation="Tanh",
        sizes=(64, 64),
        squash=None,
        discrete=None,
    ),
    ("stable_baselines3.sac.policies", "SACPolicy"): Actor(("SAC",), **_GAUSSIAN),  # type: ignore[arg-type]
    ("sb3_contrib.tqc.policies", "TQCPolicy"): Actor(("TQC",), **_GAUSSIAN),  # type: ignore[arg-type]
    ("stable_baselines3.td3.policies", "TD3Policy"): Actor(
        ("TD3", "DDPG"),
        hidden="actor.mu",
        last=None,
        unused=(*_OFF_POLICY, "actor_target."),
        sizes=(400, 300),
    ),
    ("stable_baselines3.dqn.policies", "DQNPolicy"): Actor(
        ("DQN",),
        hidden="q_net.q_net",
        last=None,
        unused=("q_net_target.",),
        sizes=(64, 64),
        squash=False,
        discrete=True,
    ),
    ("sb3_contrib.qrdqn.policies", "QRDQNPolicy"): Actor(
        ("QR-DQN",),
        hidden="quantile_net.quantile_net",
        last=None,
        unused=("quantile_net_target.",),
        sizes=(64, 64),
        squash=False,
        discrete=True,
        quantiles=200,
    ),
}
"""Module and name of a policy class to its actor."""


def actor_of(module: str, name: str) -> Actor:
    """Where a policy class keeps its actor.

    Raises:
        PolicyFileError: for a class that is not known, with the way that works.
    """
    if (module, name) in ACTORS:
        return ACTORS[module, name]
    known = ", ".join(algorithm for actor in ACTORS.values() for algorithm in actor.algorithms)
    if "recurrent" in module:
        way = f"a policy that remembers is not judged here; {RETRAIN}"
    else:
        way = (
            "judge the loaded model from Python with integ_gym.evaluate(model, env_id, out); "
            f"or {RETRAIN}"
        )
    raise PolicyFileError(
        f"the policy class is {name} of {module}, and only the 'MlpPolicy' of {known} can be read; "
        f"{way}"
    )
