"""What a run keeps of a policy that was given, and the panel that follows from it and the records.

A policy that is an object or a function leaves no file; what casts doubt on it is kept in the run's
manifest. Where there is a file, the same is read from it again.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from integ_gym.evidence.store import EvidenceStore
from integ_gym.support.errors import InputError
from integ_gym.train.policy_files.reading import unscaled

from ..cells import environments_of
from ..matrix import given_rows
from ..outputs import (
    artefact_of,
    cost_of,
    look_warnings,
    of_plan,
    reduced,
)
from ..plan import planned_home
from ..result import Panel
from ..result import Policy as PanelPolicy
from ..running.run_directory import GIVEN, MANIFEST, RunDirectory
from ..spec import PanelSpec
from .doubts import doubts_of
from .home import VARIED, Provenance, provenance
from .policy import Existing, kept_policy, read_policy_file


class Facts(msgspec.Struct, frozen=True):
    """What is known of a policy beside its hash and its home.

    Attributes:
        seed: of its training; None: not known.
        file: in its folder of the run; None for what came as an object.
        unscaled: whether it learned from scaled observations, and is given them as they are.
        statistics: whether it scales observations itself.
        bounds: of its actions, low and high; None: not known.
        overridden: arguments of its training in place of which others were given.
    """

    seed: int | None
    file: str | None
    unscaled: bool
    statistics: bool
    bounds: tuple[list[float], list[float]] | None
    overridden: dict[str, Any]


@dataclass(frozen=True)
class _Known:
    """What doubts ask of a policy."""

    policy_id: str
    content_hash: str
    bounds: tuple[list[float], list[float]] | None
    statistics: object

    def act(self, observation: NDArray[Any]) -> NDArray[Any]:
        """It does not act: nothing here plays an episode."""
        raise NotImplementedError


def facts_of(existing: Existing) -> dict[str, Any]:
    """What a run's manifest keeps of a policy."""
    facts = Facts(
        existing.seed,
        next(iter(existing.files), None),
        existing.unscaled,
        *_of_actions(existing.policy),
        dict(existing.provenance.overridden),
    )
    return dict(msgspec.to_builtins(facts))


def given_panel(spec: PanelSpec, directory: RunDirectory, called: Mapping[str, Any]) -> Panel:
    """What ``panel.json`` holds of an evaluation: a function of its manifest and records alone.

    Args:
        spec: of the evaluation.
        directory: of the run, all of which is there.
        called: see :func:`~integ_gym.eval.panel.outputs.call_of`.

    Raises:
        ValueError: where the manifest does not say what is known of the policy.
    """
    existing = _kept(spec, directory)
    name = existing.policy.policy_id
    layout, matrix = reduced(spec, directory, given_rows(spec, name, existing.home))
    file = next((f"policies/{name}/{kept}" for kept in existing.files), None)
    told: dict[str, Any] = {
        "seed": existing.seed,
        "hash": existing.policy.content_hash,
        "file": file,
    }
    policies = [PanelPolicy(id=name, **told)]
    policies += [PanelPolicy(id=x, seed=None, hash=None, file=None) for x in spec.baselines]
    store = EvidenceStore(directory.evidence)
    return artefact_of(
        directory,
        layout,
        matrix,
        policies,
        **of_plan(spec, directory, called),
        cost=cost_of(directory, layout, (), called),
        looks=layout.looks,
        warnings=(
            *doubts_of(existing, spec, layout, matrix, store),
            *look_warnings(layout),
        ),
    )


def other_facts(
    spec: PanelSpec, directory: RunDirectory, own_code: bool
) -> Iterator[tuple[str, Any, Any]]:
    """What a run says of a policy and its file does not: name, what is said, what is read.

    Raises:
        ValueError: for a file that cannot be read, or a manifest without this.
    """
    existing, said = _kept(spec, directory), _facts(directory)
    folder = directory.policies / existing.policy.policy_id
    found = kept_policy(folder)
    if found is None:
        if said.file is not None:
            yield "file", said.file, None
        return
    path, statistics = found
    policy, card, _ = read_policy_file(path, statistics)
    overridden = said.overridden
    if card is not None and existing.provenance.origin.startswith("the side-car"):
        given = {name: x for name, x in spec.environment.items() if name not in VARIED}
        overridden = dict(provenance(spec.env_id, card, None, given, own_code)[0].overridden)
    made = Facts(
        None if card is None else card.get("seed"),
        path.name,
        statistics is None and unscaled(path, card),
        *_of_actions(policy),
        overridden,
    )
    one, other = msgspec.to_builtins(said), msgspec.to_builtins(made)
    yield from ((name, one[name], other[name]) for name in one if one[name] != other[name])


def _of_actions(policy: Any) -> tuple[bool, tuple[list[float], list[float]] | None]:
    """Whether a policy scales observations, and the bounds of its actions."""
    bounds = getattr(policy, "bounds", None)
    told = None
    if bounds is not None:
        low, high = (np.asarray(end, dtype=np.float64).tolist() for end in bounds)
        told = (low, high)
    return getattr(policy, "statistics", None) is not None, told


def _facts(directory: RunDirectory) -> Facts:
    try:
        return msgspec.convert(directory.manifest().get(GIVEN), Facts)
    except msgspec.ValidationError as error:
        raise InputError(f"its {MANIFEST} does not say what the policy is ({error})") from None


def _kept(spec: PanelSpec, directory: RunDirectory) -> Existing:
    """The policy of an evaluation, as far as doubts ask for it."""
    plan, facts = directory.manifest()["specification"], _facts(directory)
    environments = environments_of(spec.testbed, spec.columns()[0], 1)
    environments.close()
    name = spec.name.removeprefix("evaluate ")
    folder = directory.policies / name
    known = Provenance(
        planned_home(plan),
        spec.control_period,
        spec.environment,
        str(plan["home"].get("origin")),
        overridden=facts.overridden,
    )
    return Existing(
        _Known(name, str(plan["policy"]), facts.bounds, facts.statistics or None),
        known,
        {} if facts.file is None else {facts.file: folder / facts.file},
        facts.seed,
        environments.single_action_space,
        facts.unscaled,
    )
