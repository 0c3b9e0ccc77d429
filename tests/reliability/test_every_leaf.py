"""Every leaf of finished runs is held against something, or listed as not proven.

All leaves of records are changed in all ways. Of files one of each kind is changed in one way, and
in each in which what is read may stay the same: a key is gone, one is added, an entry is there
twice. ``python tests/helpers/reliability/sweep.py --every`` changes all in all ways.
"""

import pytest
from leaves import Leaf, record_leaves
from sweep import (
    KINDS,
    RECORDS,
    SECURITY,
    WHOLE,
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
    """By run: all of the first, and those of the others that it does not have."""
    first = leaves_of(runs / "first")
    return {"first": first, **{name: others_of(runs / name, first) for name in WHOLE}}


@pytest.fixture(scope="module")
def sweeps(runs, tmp_path_factory):
    folder = tmp_path_factory.mktemp("sweep")
    return {name: Sweep(runs / name, folder / name) for name in ("first", *WHOLE)}


def test_a_place_is_listed_with_all_that_is_in_it():
    patterns = [("units/*.json", "start"), ("policies/*/policy.json", "versions.*")]
    for file, place, expected in (
        ("units/train-*.json", "start", True),
        ("units/train-*.json", "started", False),
        ("units/train-*.json", "start.within", True),
        ("policies/*/policy.json", "versions.torch", True),
        ("units/train-*.json", "start:within", True),
        ("policies/*/policy.json", "config.versions", False),
    ):
        assert is_listed(Leaf(file, place, "changed", "", ()), patterns) is expected


@pytest.mark.slow
def test_every_kind_of_file_and_all_that_is_listed_is_swept(leaves):
    assert {leaf.file for leaf in leaves["first"]} == set(KINDS)
    for name, kinds in WHOLE.items():
        assert {leaf.file for leaf in leaves[name]} >= set(kinds)
    every = [leaf for own in leaves.values() for leaf in own]
    for file, place in PATTERNS:
        assert any(is_listed(leaf, [(file, place)]) for leaf in every), (file, place)


@pytest.mark.slow
@pytest.mark.parametrize("of_records", [True, False])
@pytest.mark.parametrize("name", ["first", *WHOLE])
def test_a_leaf_that_is_not_listed_is_found(sweeps, leaves, name, of_records):
    own = [leaf for leaf in leaves[name] if leaf.file.startswith(RECORDS) is of_records]
    own = [leaf for leaf in own if not is_listed(leaf, PATTERNS)]
    kinds = KINDS if name == "first" else WHOLE[name]
    assert {leaf.file for leaf in own} >= {x for x in kinds if x.startswith(RECORDS) is of_records}
    found = sweeps[name].silent(own)
    assert not found, "\n".join(map(str, found))


@pytest.mark.slow
def test_no_count_of_the_fallback_is_silent_where_all_records_have_traces(runs, sweeps):
    """They are changed in each record whose controls may be the fallback's, and in others."""
    counts = ("fallback_count", "recovery_count", "saturated_share")
    own = [leaf for leaf in record_leaves(runs / "evaluated", True) if leaf.place in counts]
    assert {leaf.place for leaf in own} == set(counts)
    found = sweeps["evaluated"].silent(own, every=True)
    assert not found, "\n".join(map(str, found))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["first", "grown", "evaluated"])
def test_what_is_listed_is_silent_and_no_verdict_rests_on_it(sweeps, leaves, name):
    own = [leaf for leaf in leaves[name] if is_listed(leaf, PATTERNS)]
    # What failed has no time of success, and a page of another form is no page.
    own = [leaf for leaf in own if leaf.change not in ("added", "other kind")]
    records = [leaf for leaf in own if leaf.file.startswith(RECORDS)]
    rest = [leaf for leaf in own if leaf not in records]
    own = first_of_kind([*rest, *sweeps[name].unrefuted(records)])
    assert own
    assert sweeps[name].first_finding(own) is None
    assert set(changed_places(sweeps[name], own)) <= TIMES
