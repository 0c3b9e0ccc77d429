"""What all figures share: colours, markers, and how a figure is begun and written.

Knows pictures of numbers, not where the numbers come from.
"""

from typing import TYPE_CHECKING

from ..doors import lazy_door

if TYPE_CHECKING:
    from .colours import (
        ENERGY_FLOOR,
        PALETTE,
        VIRIDIS,
        channels,
        ink_on,
        mixed,
        success_colour,
        symlog,
    )
    from .series import DASHES, HUES, MARKERS, SeriesStyle, SeriesStyles
    from .style import (
        COOL,
        FORMATS,
        INK,
        LINE,
        PAPER,
        SOFT,
        SUNK,
        WARM,
        Entry,
        axes_at,
        bare,
        blank_figure,
        draw_heading,
        draw_legend,
        inch_canvas,
        legend_lines,
        line_style,
        marker_style,
        plain,
        scheme_entries,
        write_figure,
    )
else:
    __getattr__, __dir__ = lazy_door(__name__)
