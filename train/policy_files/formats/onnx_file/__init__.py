"""Policies as ONNX: written with all that decides their actions, read without running a stranger's.

A feed-forward graph becomes our own policy; any other is run by onnxruntime. Metadata holds what a
side-car does.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .reading import onnx_card, onnx_data, read_onnx
    from .runtime_policy import OnnxPolicy
    from .writing import onnx_bytes
else:
    __getattr__, __dir__ = lazy_door(__name__)
