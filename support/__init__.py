"""What any program needs: optional packages, parameters, files, processes, terminals, pages.

Lowest of all floors: it knows nothing of plants, policies or panels, and imports nothing above it.
"""

from typing import TYPE_CHECKING

from .doors import lazy_door

if TYPE_CHECKING:
    from .figures.colours import (
        ENERGY_FLOOR,
        PALETTE,
        VIRIDIS,
        ink_on,
        mixed,
        success_colour,
        symlog,
    )
    from .figures.series import DASHES, HUES, MARKERS, SeriesStyle, SeriesStyles
    from .figures.style import (
        BOLD,
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
        fitting,
        inch_canvas,
        legend_lines,
        line_style,
        marker_style,
        plain,
        scheme_entries,
        write_figure,
    )
    from .files import (
        Kinds,
        cannot_write,
        check_regular,
        checked_object,
        file_hash,
        make_folder,
        new_path,
        parse_json,
        read_bounded,
        read_json,
        read_object,
        remove_leftovers,
        replace_file,
        told_path,
        write_json,
        write_once,
    )
    from .packages import (
        APART,
        Apart,
        Registry,
        Worker,
        WorkerError,
        absent,
        install_command,
        installed_versions,
        load,
        missing,
        package_version,
        require,
        running_version,
    )
    from .pages import page_environment, page_parts
    from .parameters import (
        boolean,
        check_values,
        finite_number,
        nonnegative,
        one_of,
        optional,
        parameter,
        positive,
        suggestion,
        text,
        units,
        unknown_name,
    )
    from .processes import (
        FileLock,
        Progress,
        SpawnError,
        check_spawning,
        cores,
        host,
        instruction_sets,
        limit_threads,
        report_work,
        work_bar,
    )
    from .sharing import (
        EXECUTORS,
        LEASE,
        Claim,
        ClaimError,
        Claims,
        Cluster,
        ClusterError,
        FolderFiles,
        Gone,
        Resources,
        check_sharing,
        cluster_of,
        held,
        pauses,
        was_committed,
    )
    from .terminal import (
        DIM,
        FITS,
        GREEN,
        NONE,
        RED,
        YELLOW,
        CommandParser,
        beside,
        compact,
        end_quietly,
        fits,
        fixed,
        named_value,
        plural,
        print_aligned,
        print_groups,
        report_errors,
        say,
        seconds,
        step,
        told_command,
        true_minus,
        unbroken,
        visible,
        whole_number,
        width_of,
    )
else:
    __getattr__, __dir__ = lazy_door(__name__)
