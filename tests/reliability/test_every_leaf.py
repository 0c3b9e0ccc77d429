"""Every leaf of a run's JSON files and schemas is held against something, or listed as not proven.

``python tests/helpers/reliability/sweep.py --every`` changes those of records too, which takes an
hour, and all of them in all ways.
"""

from __future__ import annotations

import pytest
from leaves import Leaf
from sweep import SECURITY, Sweep, is_listed, leaves_of, listed, make_run, told_otherwise

from integ_gym.evidence.schema.fields import PHASES

FILES = ("panel.json", "run.json", "policies/", "units/", "schema of ")
KINDS = (
    *FILES,
    *(f"records of {phase}, {trace}" for phase in PHASES for trace in ("traced", "untraced")),
)
PATTERNS = listed(SECURITY.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def swept(made_once, tmp_path_factory):
    folder = made_once("swept", make_run)
    return Sweep(folder / "run", tmp_path_factory.mktemp("sweep") / "run")


@pytest.fixture(scope="module")
def leaves(swept):
    return leaves_of(swept.run)


def test_a_place_is_listed_with_all_that_is_in_it():
    patterns = [("units/*.json", "start"), ("policies/*/policy.json", "versions.*")]
    for file, place, expected in (
        ("units/train-*.json", "start", True),
        ("units/train-*.json", "started", False),
        ("units/train-*.json", "start.within", True),
        ("policies/*/policy.json", "versions.torch", True),
        ("policies/*/policy.json", "config.versions", False),
    ):
        assert is_listed(Leaf(file, place, "changed", "", ()), patterns) is expected


def test_the_list_is_read():
    assert ("policies/*/policy.json", "platform") in PATTERNS


@pytest.mark.slow
def test_every_kind_of_file_is_swept(leaves):
    assert all(leaf.file.startswith(KINDS) for leaf in leaves)


@pytest.mark.slow
@pytest.mark.parametrize("kind", FILES)
def test_a_leaf_that_is_not_listed_is_found(swept, leaves, kind):
    own = [leaf for leaf in leaves if leaf.file.startswith(kind)]
    assert own
    silent = swept.silent([leaf for leaf in own if not is_listed(leaf, PATTERNS)])
    assert not silent, "\n".join(map(str, silent))


@pytest.mark.slow
def test_what_is_listed_is_silent_and_no_verdict_rests_on_it(swept, leaves):
    own = [leaf for leaf in leaves if is_listed(leaf, PATTERNS)]
    for file, place in PATTERNS:
        assert any(is_listed(leaf, [(file, place)]) for leaf in own), (file, place)
    # What failed has no time of success, and a page of another form is no page.
    own = [leaf for leaf in own if leaf.change not in ("added", "other kind")]
    assert swept.first_finding(own) is None
    places = {place.split(".")[0] for place in told_otherwise(swept, own)}
    assert places <= {"cost", "training_costs"}
