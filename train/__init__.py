"""Training with stable-baselines3 or as a compiled fleet, baselines, and policies' files.

This floor makes policies and gives them one seat to act from; judging them is not its business.
`ppo.py` is the script to read first.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .algorithms import ALGORITHMS, Algorithm
    from .baselines import BASELINES, has_handmade, make_baseline, possible_baselines
    from .command import training_command, training_parser
    from .fleet import (
        GIB_PER_WORKER,
        Workers,
        fleet_workers,
        plan,
        preparation,
        train_fleet,
        train_together,
        training_seconds,
        workers_of,
    )
    from .monitoring import DiscretizationCallback, RawModel, discretization_gap
    from .policy import CalledPolicy, MlpPolicy, Policy, PolicyStack, behaviour_hash
    from .policy_files import (
        HASH_KEY,
        HOW_TO_STATE,
        LAST_EPISODES,
        ONNX_ENDING,
        POLICY_ENDINGS,
        POLICY_FILE,
        STATE_DICT_ENDINGS,
        STOCK,
        UNKNOWN,
        WEIGHTS_FILE,
        OnnxPolicy,
        PolicyFileError,
        Stated,
        TrainedPolicy,
        card_hash,
        episode_summary,
        has_sidecar,
        lacks_statistics,
        make_card,
        mixture_of,
        onnx_card,
        onnx_data,
        policy_file,
        read_sb3_model,
        read_trained,
        read_weights,
        readable_file,
        save_policy,
        stated_arguments,
        unscaled,
        write_sidecar,
        zip_faults,
    )
    from .ppo import PPOConfig, train_ppo
    from .running import TrainingConfig, TrainingError, TrainingEvidence, training_bar
    from .sac import SACConfig, train_sac
else:
    __getattr__, __dir__ = lazy_door(__name__)
