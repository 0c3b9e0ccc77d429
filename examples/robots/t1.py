"""Booster's T1 as MuJoCo Playground trains it.

``integ-gym evaluate DIR/policy.onnx --env examples.robots.t1:T1 --env-arg folder=DIR``
"""

from .humanoid import Humanoid


class T1(Humanoid):
    """23 joints, of which its policy does not see the two of the head."""

    keyframe = "home"
    scale = 1.0
    unseen, still = 2, 0.01
