"""Cells of the documentation's tables, as a narrow screen wants them."""

from __future__ import annotations

from site_modules import loaded

cells = loaded("cells").on_page_content


def test_the_digits_of_a_number_stay_together():
    assert cells("<td>20 500 000 steps</td>") == "<td>20\xa0500\xa0000 steps</td>"
    for other in ("<td>5 1000</td>", "<td>rk4 of 8 plants</td>", "<p>20 500 000</p>"):
        assert cells(other) == other
    assert cells('<td><a href="a 100">1 100</a></td>') == '<td><a href="a 100">1\xa0100</a></td>'


def test_a_sentence_is_given_room():
    sentence = "A sentence that would stand one word a line."
    assert cells(f"<td>{sentence}</td>") == f'<td class="long">{sentence}</td>'
    short = f'<td><a title="{sentence}">short</a>\n</td>'
    assert cells(short) == short
