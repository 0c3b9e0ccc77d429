"""Optional packages, versions of installed ones, and registries made of the modules in a folder.

Knows how packages are found and named, not what they are for.
"""

from typing import TYPE_CHECKING

from ..doors import lazy_door

if TYPE_CHECKING:
    from .apart import APART, Apart, Worker, WorkerError
    from .discovery import Registry, describe_exception, raised_here, translate_errors
    from .extras import absent, install_command, load, missing, require
    from .versions import check_versions, installed_versions, package_version, running_version
else:
    __getattr__, __dir__ = lazy_door(__name__)
