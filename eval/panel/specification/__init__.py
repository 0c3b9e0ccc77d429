"""The panel's specification: read from TOML, checked, expanded into rows and cells.

Knows what is to be done and nothing of what came out.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .cells import (
        UNNAMED,
        Cell,
        DiscretizationMixture,
        Home,
        changes_of,
        engine_versions,
        environments_of,
        file_name,
        is_engine,
        main_home,
        map_of,
        standard_perturbations,
        swept_name,
        training_arguments,
    )
    from .difference import GROWING, additions, continued, contradictions
    from .growth import grown, inputs, stages
    from .panel_spec import ALGORITHM, TRAINERS, PanelSpec
    from .planned import names_code, planned_home, planned_spec, texts_of
    from .reading import BUILT_IN, built_in_spec, parse_spec, read_spec, read_toml
    from .values import SpecError
else:
    __getattr__, __dir__ = lazy_door(__name__)
