"""The gap between discretizations, followed while stable-baselines3 trains."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from integ_gym.envs.settings import DISCRETIZATION, Discretization
from integ_gym.support.errors import InputError
from integ_gym.support.optional import missing_package

from .monitoring import RawModel, comparison_cells, discretization_gap, send_to_trackers
from .policy_files.sidecar import Stated

try:
    from stable_baselines3.common.callbacks import BaseCallback
except ModuleNotFoundError as error:
    raise missing_package(str(error.name), "train") from error


class DiscretizationCallback(BaseCallback):
    """Evaluates the policy on a few other discretizations while it is trained.

    ``discretization/return_gap`` and its parts (see :func:`discretization_gap`) appear beside the
    return in the model's logger, TensorBoard among its outputs, and in the run of Weights & Biases
    or MLflow that the process has open. Statistics of a `VecNormalize` are applied as they are at
    that moment.

    Args:
        every: environment steps between two evaluations.
        env_id: environment to evaluate in; by default that of the training, which must then be one
            of integ-gym's.
        home: what the policy is trained on; by default what the training environment says.
        others: to compare with; by default the truth and all integrators at home's step.
        episodes: starts of each evaluation, the same every time.
        environment: further constructor arguments; by default the training environment's.
        verbose: 1 prints the gap.

    Raises:
        TypeError, ValueError: when training begins, if the home is neither given nor known from the
            environment, or a discretization cannot be made; see :func:`discretization_gap`.
    """

    def __init__(
        self,
        every: int = 10_000,
        *,
        env_id: str | None = None,
        home: Stated = None,
        others: Iterable[Stated] = (),
        episodes: int = 10,
        environment: Mapping[str, Any] | None = None,
        verbose: int = 0,
    ) -> None:
        super().__init__(verbose)
        if every < 1 or episodes < 1:
            raise InputError(f"`every` and `episodes` must be 1 or above, got {every}, {episodes}")
        self._every = every
        self._env_id, self._home, self._environment = env_id, home, environment
        self._others, self._episodes = tuple(others), episodes
        self._next = every

    def _on_training_start(self) -> None:
        self._next = self.num_timesteps + self._every
        known = self.training_env.has_attr("setup")
        if not known and (self._env_id is None or self._home is None):
            raise InputError(
                "the training environment does not say its discretization; give "
                "DiscretizationCallback(env_id=..., home='integrator=…,dt=…'), or home='stock'"
            )
        if known:
            setups = self.training_env.get_attr("setup")
            if self.training_env.has_attr("mixture"):
                mixtures = self.training_env.get_attr("mixture")
                setups = [setup for mixture in mixtures for setup in mixture.setups]
            self._take_over(setups)
        comparison_cells(str(self._env_id), self._home, self._others, self._environment or {})

    def _take_over(self, setups: Sequence[Any]) -> None:
        """What was not given, from what the training environments run on."""
        if self._home is None:
            homes = {Discretization.of(setup) for setup in setups}
            if len(homes) > 1:
                names = ", ".join(sorted(home.name for home in homes))
                raise InputError(
                    f"the training runs on several discretizations ({names}), so none is home; "
                    "give DiscretizationCallback(home='integrator=…,dt=…')"
                )
            self._home = homes.pop()
        spec = self.training_env.get_attr("spec")[0]
        trained_in = spec.id if spec else None
        self._env_id = self._env_id or trained_in
        if self._environment is None and self._env_id == trained_in:
            arguments = setups[0].arguments()
            self._environment = {k: x for k, x in arguments.items() if k not in DISCRETIZATION}

    def _on_step(self) -> bool:
        if self.num_timesteps >= self._next:
            self._next = self.num_timesteps + self._every
            self._evaluate()
        return True

    def _evaluate(self) -> None:
        assert self._env_id is not None
        scores = discretization_gap(
            RawModel(self.model),
            self._env_id,
            self._home,
            others=self._others,
            episodes=self._episodes,
            environment=self._environment,
        )
        for name, value in scores.items():
            self.logger.record(name, value)
        self.logger.record("time/total_timesteps", self.num_timesteps, exclude="tensorboard")
        self.logger.dump(self.num_timesteps)
        send_to_trackers(scores, self.num_timesteps)
        if self.verbose:
            parts = ", ".join(f"{k.partition('/')[2]} {x:.3g}" for k, x in scores.items())
            print(f"{self.num_timesteps} steps: {parts}")
