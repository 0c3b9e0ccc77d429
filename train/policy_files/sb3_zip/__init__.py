"""Read a policy that stable-baselines3 (SB3) saved, without executing anything stored in it.

SB3's own `load` unpickles arbitrary objects from the member `data`, so opening a stranger's file
runs a stranger's program. Here the weights come from `policy.pth` through torch's restricted
reader (`weights_only=True`), and the architecture, the activation and the spaces from the readable
half of the JSON in `data`; the pickled half is never decoded. What the readable half does not
settle is refused, never guessed. SB3 itself is not needed.
"""

from ..error import PolicyFileError
from .observation_statistics import read_observation_statistics
from .reading import read_sb3_zip

__all__ = ["PolicyFileError", "read_observation_statistics", "read_sb3_zip"]
