"""`vecnormalize.pkl` of stable-baselines3, read as data: nothing that it names is ever called.

Knows the opcodes of pickles and what `VecNormalize` holds; imports nothing that a file names.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .inert_pickle import Name, Note, entries, looks_pickled, names_in, parse_pickle
    from .reading import pickled_kind, read_vec_normalize
else:
    __getattr__, __dir__ = lazy_door(__name__)
