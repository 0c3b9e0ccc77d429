"""What the trainer with stable-baselines3 stands on: vector environments, models, progress."""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .initial_weights import Stack, initial_stack, state_dict
    from .model import (
        Tell,
        can_save,
        import_ahead,
        last_episodes,
        logger,
        reproducible,
        saved,
        telling,
        zip_of_weights,
    )
    from .vec_env import Sb3VecEnv, ScaledRewards
else:
    __getattr__, __dir__ = lazy_door(__name__)
