"""Rows and cells: discretizations, mixtures and engines, perturbations and sweeps.

Knows single cells and rows, not the panel that they are of.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .cell import (
        UNNAMED,
        Cell,
        DiscretizationMixture,
        Home,
        Perturbation,
        changes_of,
        environments_of,
        file_name,
        main_home,
        nominal_setup,
        training_arguments,
    )
    from .discretizations import asks_for_installed, evaluated, trained
    from .engines import absent_engines, engine_versions, is_engine, map_of
    from .perturbations import perturbations_of, standard_perturbations
    from .sweeps import Sweep, sweeps_of, swept_name
else:
    __getattr__, __dir__ = lazy_door(__name__)
