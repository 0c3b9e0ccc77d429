"""Every leaf of finished runs is held against something, or listed as not proven.

All leaves of records are changed in all ways, of files one of each kind in one way;
``python tests/helpers/reliability/sweep.py --every`` changes all in all ways.
"""

from __future__ import annotations

import pytest
from leaves import Leaf
from sweep import (
    KINDS,
    OTHER_RUNS,
    SECURITY,
    Sweep,
    changed_places,
    first_of_kind,
    is_listed,
    leaves_of,
    listed,
    make_runs,
    others_of,
)

PATTERNS = listed(SECURITY.read_text(encoding="utf-8"))

TIMES = {"cost.wall_seconds", "cost.train_seconds", "cost.evaluate_seconds"}
"""Numbers of a page that are as the machine told them."""


@pytest.fixture(scope="module")
def runs(made_once):
    return made_once("swept", make_runs)


@pytest.fixture(scope="module")
def leaves(runs):
    return leaves_of(runs / "first")


@pytest.fixture(scope="module")
def sweep(runs, tmp_path_factory):
    return Sweep(runs / "first", tmp_path_factory.mktemp("sweep") / "first")


@pytest.fixture(scope="module")
def silent(sweep, leaves):
    return sweep.silent([leaf for leaf in leaves if not is_listed(leaf, PATTERNS)])


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
    assert {leaf.file for leaf in leaves} == set(KINDS)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_leaf_that_is_not_listed_is_found(silent, leaves, kind):
    assert any(leaf.file == kind and not is_listed(leaf, PATTERNS) for leaf in leaves)
    own = [str(leaf) for leaf in silent if leaf.file == kind]
    assert not own, "\n".join(own)


@pytest.mark.slow
@pytest.mark.parametrize("name", OTHER_RUNS)
def test_leaves_that_other_runs_alone_have_are_found(runs, leaves, name, tmp_path):
    own = [x for x in others_of(runs / name, leaves) if not is_listed(x, PATTERNS)]
    assert own
    found = Sweep(runs / name, tmp_path / name).silent(own)
    assert not found, "\n".join(map(str, found))


@pytest.mark.slow
def test_what_is_listed_is_silent_and_no_verdict_rests_on_it(sweep, leaves):
    own = [leaf for leaf in leaves if is_listed(leaf, PATTERNS)]
    for file, place in PATTERNS:
        assert any(is_listed(leaf, [(file, place)]) for leaf in own), (file, place)
    # What failed has no time of success, and a page of another form is no page.
    own = first_of_kind([leaf for leaf in own if leaf.change not in ("added", "other kind")])
    assert sweep.first_finding(own) is None
    assert set(changed_places(sweep, own)) <= TIMES
