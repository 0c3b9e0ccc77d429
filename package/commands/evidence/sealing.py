"""``integ-gym evidence seal``: one hash that pins a run, and who says so."""

from __future__ import annotations

import argparse
from pathlib import Path

from integ_gym.evidence.schema.errors import EvidenceError
from integ_gym.evidence.store.store import EvidenceStore
from integ_gym.evidence.verification.sealing import SEAL_FILE, broken_seals, seal
from integ_gym.evidence.verification.signing import read_key, sign


def add_arguments(command: argparse.ArgumentParser) -> None:
    """The options of `seal`."""
    command.add_argument(
        "--sign", type=Path, metavar="KEY",
        help="sign it with this private key, as ssh-keygen -t ed25519 makes them",
    )  # fmt: skip


def seal_run(store: EvidenceStore, given: argparse.Namespace) -> int:
    """Seal a run, sign the seal if a key is given, and print both: 0.

    Raises:
        EvidenceError: if the run has a seal that does not hold, or the key cannot sign.
    """
    run = store.run
    key = None if given.sign is None else read_key(given.sign)
    for broken in broken_seals(run):
        raise EvidenceError(
            f"{run} has a seal that does not hold: {broken}; find out why, and remove "
            f"{run / SEAL_FILE} to seal what is there now"
        )
    print(f"Seal: {seal(run)}")
    if key is not None:
        print(f"Signed by {sign(run, key).fingerprint}")
    return 0
