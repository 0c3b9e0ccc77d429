"""What a policy's weights can be kept in: one room or file for each format.

Knows formats; a side-car's card is given to them.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .onnx_file import OnnxPolicy, onnx_bytes, onnx_card, onnx_data, read_onnx
    from .safetensors_file import read_safetensors, safetensors_bytes
    from .sb3_zip import (
        GivenStatistics,
        is_scaled,
        lacks_statistics,
        observation_statistics_of,
        read_archive,
        read_observation_statistics,
        read_sb3_model,
        read_sb3_zip,
        zip_faults,
    )
    from .state_dict import STATE_DICT_ENDINGS, normalizes, read_state_dict
else:
    __getattr__, __dir__ = lazy_door(__name__)
