"""Records as they are, in Parquet, with what finds and explains a data set beside them."""

from __future__ import annotations

import re
from pathlib import Path

from integ_gym.support import replace_file, write_json

from ..store import EvidenceStore
from .croissant import CROISSANT_FILE, croissant
from .data_card import CARD_FILE, data_card
from .selection import Selection


def write_parquet(chosen: Selection, folder: Path) -> int:
    """Write a file of records for each environment, a Croissant description and a data card.

    Rows are those of the store, bit by bit, with their hashes: the folder is a run that all of
    `integ-gym evidence` reads.
    """
    store = EvidenceStore(folder / "evidence")
    for env_id in chosen.env_ids:
        name = re.sub(r"[^A-Za-z0-9._-]+", "-", env_id).strip("._-") or "environment"
        store.commit_all(name, chosen.tables(env_id))
    write_json(folder / CROISSANT_FILE, croissant(chosen, store))
    replace_file(folder / CARD_FILE, data_card(chosen, store).encode())
    return store.count()
