"""Read a policy that stable-baselines3 (SB3) saved, without executing anything stored in it.

`read_sb3_zip` opens the zip, takes the weights with torch's restricted reader and the architecture
from the readable half of its JSON.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .limits import MAX_WEIGHTS_BYTES
    from .observation_statistics import (
        GivenStatistics,
        observation_statistics_of,
        read_observation_statistics,
    )
    from .published import zip_faults
    from .reading import (
        is_scaled,
        lacks_statistics,
        read_archive,
        read_sb3_model,
        read_sb3_zip,
    )
    from .weights import load_tensors
else:
    __getattr__, __dir__ = lazy_door(__name__)
