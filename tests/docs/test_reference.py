"""What the site's pages are made from: every public name, docstrings, and cells of tables."""

from __future__ import annotations

from site_modules import loaded

import integ_gym


def test_every_public_name_is_on_one_page():
    named = [name for _, _, names in loaded("generated").API.values() for name in names]
    assert sorted(named) == sorted(integ_gym.__all__)
