"""What the site's reference is made from leaves no public name out, and reads docstrings."""

from __future__ import annotations

import pytest
from site_modules import loaded

import integ_gym


def test_every_public_name_is_on_one_page():
    named = [name for _, _, names in loaded("generated").API.values() for name in names]
    assert sorted(named) == sorted(integ_gym.__all__)


@pytest.mark.parametrize(
    ("written", "read"),
    [
        ("See :class:`IntegEnv`.", "See [`IntegEnv`][integ_gym.IntegEnv]."),
        ("See :func:`~integ_gym.train.runs.train_ppo`.", "See [`train_ppo`][integ_gym.train_ppo]."),
        ("A :class:`Stops`.", "A `Stops`."),
        (".. math:: a = b", "`a = b`"),
        ("Adds.\n\n>>> 1 + 1\n2\n\nSo.", "Adds.\n\n```pycon\n>>> 1 + 1\n2\n```\n\nSo."),
    ],
)
def test_docstrings_become_markdown(written, read):
    assert loaded("roles").as_markdown(written) == read
