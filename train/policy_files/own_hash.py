"""A card's hash of itself: of home, environment arguments, bounds and all else that it says.

`content_hash` is of what decides the actions, and names a policy in evidence; the hash here is of
what is said about that policy, which decides what its results mean.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .error import PolicyFileError

HASH_KEY = "card_hash"

FORMAT = "integ-gym policy 2"
UNHASHED_FORMAT = "integ-gym policy 1"
"""Of side-cars from before they had a hash of themselves."""


def card_hash(card: Mapping[str, Any]) -> str:
    """SHA-256 (hex) of a card without its own hash: JSON with sorted keys and without spaces.

    Raises:
        ValueError: for what is no JSON.
    """
    told = json.loads(json.dumps({k: x for k, x in card.items() if k != HASH_KEY}))
    text = json.dumps(
        told, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False
    )
    return hashlib.sha256(text.encode()).hexdigest()


def hashed(card: Mapping[str, Any]) -> dict[str, Any]:
    """A card with its hash of itself."""
    return {**card, HASH_KEY: card_hash(card)}


def check_own_hash(card: Mapping[str, Any], file: Path, remedy: str) -> None:
    """Refuse a card that was edited after it was written.

    Args:
        card: what ``file`` says; one of before there was such a hash passes without.
        file: for the message.
        remedy: what helps, as the end of a sentence.

    Raises:
        PolicyFileError: in one sentence.
    """
    if HASH_KEY not in card and card.get("format") != FORMAT:
        return
    if card.get(HASH_KEY) != card_hash(card):
        raise PolicyFileError(
            f"{file}: was edited after it was written, for its `{HASH_KEY}` does not fit what it "
            f"says; {remedy}"
        )
