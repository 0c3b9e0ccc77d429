"""What all baselines have in common."""

from __future__ import annotations

import hashlib
import json
from functools import cached_property
from typing import Any


class Baseline:
    """What all baselines have: a name, and a hash over the name and the design parameters."""

    policy_id: str

    def parameters(self) -> dict[str, Any]:
        """Everything that decides the actions, JSON-serialisable."""
        raise NotImplementedError

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 (hex) over class, name and design parameters, the same in every process."""
        described = {
            "format": "integ-gym baseline 1",
            "class": type(self).__name__,
            "name": self.policy_id,
            "parameters": self.parameters(),
        }
        return hashlib.sha256(json.dumps(described, sort_keys=True).encode()).hexdigest()
