"""What commands have in common: arguments, tables and text that fit, numbers, how a command ends.

Knows terminals, not what is told in them.
"""

from typing import TYPE_CHECKING

from ..doors import lazy_door

if TYPE_CHECKING:
    from .colour import DIM, GREEN, RED, YELLOW, painted, shows_colours
    from .command_line import CommandParser, told_command
    from .ending import SHORT_OF_MEMORY, end_quietly, is_short_of_memory, report_errors
    from .formatting import (
        NONE,
        compact,
        compact_percent,
        fixed,
        percent,
        plural,
        seconds,
        step,
        together,
        true_minus,
    )
    from .options import (
        add_named_values,
        by_name,
        named_value,
        refuse_unused,
        run_place,
        whole_number,
    )
    from .text_table import (
        FITS,
        beside,
        fits,
        print_aligned,
        print_groups,
        say,
        stands_in_columns,
        unbroken,
        visible,
        width_of,
    )
else:
    __getattr__, __dir__ = lazy_door(__name__)
