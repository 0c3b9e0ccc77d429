"""What the site's pages are made from: every public name, docstrings, and cells of tables."""

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


@pytest.mark.parametrize(
    ("written", "read"),
    [
        ("<td>all 20 500 000</td>", "<td>all 20\xa0500\xa0000</td>"),
        ("<td>of 5 1000</td>", None),
        ('<td>a <a href="a 100">1 100</a></td>', '<td>a <a href="a 100">1\xa0100</a></td>'),
        (f"<td>{'A word. ' * 6}</td>", f'<td class="long">{"A word. " * 6}</td>'),
        (f'<td><a title="{"A word. " * 6}">short</a>\n</td>', None),
        ("<td><code>symplectic_euler</code></td>", None),
        (
            "<td><code>symplectic_euler_implicit_damping</code></td>",
            '<td><code class="long">symplectic_<wbr>euler_<wbr>implicit_<wbr>damping</code></td>',
        ),
    ],
)
def test_cells_keep_numbers_together_and_give_sentences_room(written, read):
    assert loaded("cells").on_page_content(written) == (read or written)
