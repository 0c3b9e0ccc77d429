"""The Berkeley Humanoid as MuJoCo Playground trains it.

``integ-gym evaluate DIR/policy.onnx --env examples.robots.berkeley_humanoid:BerkeleyHumanoid \
--env-arg folder=DIR``
"""

from .humanoid import Humanoid


class BerkeleyHumanoid(Humanoid):
    """12 joints."""

    keyframe = "home"
