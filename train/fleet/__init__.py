"""The fleet trainer: PPO of many policies at once, compiled with JAX, on all cores or GPUs.

Knows the hyperparameters and files of the reference trainer, and the functional environments.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .planning import plan, training_seconds
    from .training import preparation, train_fleet, train_in_stages, train_together
    from .worker import GIB_PER_WORKER, Workers, fleet_workers, workers_of
else:
    __getattr__, __dir__ = lazy_door(__name__)
