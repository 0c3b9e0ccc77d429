"""Controllers that nobody trained, for the same seat as a trained policy.

`random` and `zero` say what no skill reaches; `handmade` says what the physics allows. Where a
trained policy fails and `handmade` succeeds, learning has failed, not the actuator.
"""

from .making import BASELINES, has_handmade, make_baseline, possible_baselines

__all__ = ["BASELINES", "has_handmade", "make_baseline", "possible_baselines"]
