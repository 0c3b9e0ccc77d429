"""What the page and the figures both read out of ``panel.json``; nothing is computed or drawn."""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .axes import RATE_AXIS, Axis, difference_axis, value_axis
    from .checks import check_forest
    from .findings import findings_of
    from .forest import Forest, Line, Mark, Tone
    from .gaps import VERDICT_ORDER, gap_forest, ordered_verdicts
    from .ladders import LadderPlot, LadderPlots, Series, ladder_plots, thinned
    from .matrices import (
        Matrix,
        MatrixLine,
        Shade,
        energy_matrix,
        loss_matrix,
        mean_words,
        return_matrix,
        solved_words,
        success_matrix,
        time_matrix,
    )
    from .paired import paired_return, paired_success
    from .remedy import costs_of, mixtures_of, remedy_forest
    from .sweeps import sweep_plots
    from .trust import CLASS_WORDS, Trust, trust_of
else:
    __getattr__, __dir__ = lazy_door(__name__)
