"""Episodes that a run does not have, and columns that are told in other units than they have."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from integ_gym.envs.registries import ENVIRONMENTS
from integ_gym.support.optional import package_version
from integ_gym.support.terminal import plural

from ..episodes.decisions import told_setup
from ..episodes.record import told_json
from ..schema.arrow import ENV_KEY, VERSION_KEY, described
from ..schema.errors import EvidenceError, Finding
from ..schema.fields import LATER_ATTEMPT, SCHEMA_VERSION, SECOND_HORIZON
from ..schema.trace_fields import record_fields
from ..store.parquet_file import check_schema, read
from ..store.store import EvidenceStore

_COUNTED = """
SELECT phase, cell, policy_id, policy_hash, min(episode_index) AS first, max(episode_index) AS last,
       count(DISTINCT episode_index) AS present, count(*) AS records
FROM records GROUP BY ALL HAVING present < last - first + 1 OR records > present
ORDER BY phase, cell, policy_id, policy_hash
"""


_OF_FAILURES = (SECOND_HORIZON, LATER_ATTEMPT)
"""Phases that hold the episodes alone that failed within one horizon."""


def missing_episodes(store: EvidenceStore, part: bool = False) -> Iterator[Finding]:
    """Cells in which episodes between the first and the last are missing, or there twice.

    Args:
        store: of the records.
        part: whether they are a part of a run's, of which some may be missing.
    """
    for row in store.query(_COUNTED).to_pylist():
        some = part or row["phase"] in _OF_FAILURES
        missing = 0 if some else row["last"] - row["first"] + 1 - row["present"]
        twice = row["records"] - row["present"]
        episodes = f"of episodes {row['first']} to {row['last']}"
        counts = [f"{missing} missing {episodes}"] if missing else []
        counts += [f"{plural(twice, 'record')} too many {episodes}"] if twice else []
        if counts:
            yield Finding(_named(row), None, ", ".join(counts))


def _named(row: dict[str, Any]) -> str:
    return f"cell {row['cell']!r}, policy {row['policy_id']!r}"


_MEANT = ("unit", "frame", "at")
"""What a column's metadata says of its numbers; the rest are words."""


def other_columns(store: EvidenceStore) -> Iterator[Finding]:
    """Columns of our own environments whose unit, frame or place in time is told otherwise.

    Files of earlier schema versions are left out; of records that say that this version of
    integ-gym made them, an earlier schema version is found.

    Raises:
        EvidenceError: for a file that cannot be read.
    """
    for file in store.files():
        schema = check_schema(file)
        told = {key.decode(): value.decode() for key, value in schema.metadata.items()}
        rows = read(file, columns=["env_id", "arguments", "schema_version", "package_versions"])
        for name, key in (("env_id", ENV_KEY), ("schema_version", VERSION_KEY)):
            said = told.get(key.decode())
            if any(str(value) != said for value in set(rows.column(name).to_pylist())):
                yield Finding(file.name, None, f"its metadata say {name} {said!r}, its records not")
        version, own = told[VERSION_KEY.decode()], package_version("integ-gym")
        made_by = map(_maker, set(rows.column("package_versions").to_pylist()))
        if version != str(SCHEMA_VERSION) and own in made_by:
            message = (
                f"it has schema version {version}, and its records say that integ-gym {own} made "
                f"them, which writes {SCHEMA_VERSION}"
            )
            yield Finding(file.name, None, message)
        env_id = told.get(ENV_KEY.decode(), "")
        if version != str(SCHEMA_VERSION) or env_id not in ENVIRONMENTS:
            continue
        setup = told_setup(env_id, rows.column("arguments")[0].as_py())
        for field in record_fields(setup.plant, setup.task):
            found = described(schema.field(field.name)) if field.name in schema.names else {}
            for about in _MEANT:
                wanted = getattr(field, about)
                if found.get(about) != wanted:
                    message = (
                        f"column {field.name}: {about} is {found.get(about)!r}, not {wanted!r}"
                    )
                    yield Finding(file.name, None, message)


def _maker(package_versions: str) -> str | None:
    """Version of integ-gym that made a record; None where it does not say."""
    try:
        return str(told_json("package_versions", package_versions)["integ-gym"])
    except (EvidenceError, LookupError, TypeError):
        return None
