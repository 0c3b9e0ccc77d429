"""What a record is: its fields with units, as Arrow and JSON schemas, and its content hash.

Knows what is recorded, not when or where.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .arrow import ENV_KEY, VERSION_KEY, arrow_schema, arrow_type, described, is_trace
    from .content_hash import content_hashes, with_hashes
    from .description import in_words, package_versions, staleness
    from .errors import BatchExistsError, EvidenceError, Finding
    from .extra import duckdb, parquet, pyarrow
    from .fields import (
        ATTEMPT,
        LATER_ATTEMPT,
        PHASES,
        SCHEMA_VERSION,
        SECOND_HORIZON,
        SUMMARY_FIELDS,
        VOLATILE_NAMES,
        Field,
    )
    from .trace_fields import CONTACT_TRACE, record_fields
else:
    __getattr__, __dir__ = lazy_door(__name__)
