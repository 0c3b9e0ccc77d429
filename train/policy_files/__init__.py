"""The files of a policy: weights, side-car, and stable-baselines3's zip, read without pickle.

Knows formats and doubts every file; executes nothing that a file holds.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .card import LAST_EPISODES, episode_summary, make_card, mixture_of, told
    from .error import PolicyFileError
    from .formats import (
        STATE_DICT_ENDINGS,
        OnnxPolicy,
        lacks_statistics,
        onnx_card,
        onnx_data,
        read_observation_statistics,
        read_sb3_model,
        read_sb3_zip,
        zip_faults,
    )
    from .own_hash import HASH_KEY, card_hash
    from .reading import ONNX_ENDING, POLICY_ENDINGS, read_weights, unscaled
    from .sidecar import (
        POLICY_FILE,
        SIDECAR_FILE,
        WEIGHTS_FILE,
        TrainedPolicy,
        actor_of,
        check_folder,
        has_sidecar,
        policy_file,
        read_trained,
        readable_file,
        write_actor,
        write_policy,
    )
    from .stated_home import HOW_TO_STATE, STOCK, UNKNOWN, Stated, stated_arguments
    from .writing import save_policy, write_sidecar
else:
    __getattr__, __dir__ = lazy_door(__name__)
