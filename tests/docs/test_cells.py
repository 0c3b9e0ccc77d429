"""Cells of the documentation's tables, as a narrow screen wants them."""

from __future__ import annotations

from site_modules import loaded

cells = loaded("cells").on_page_content


def test_the_digits_of_a_number_stay_together():
    assert cells("<td>all 20 500 000</td>") == "<td>all 20\xa0500\xa0000</td>"
    for other in ("<td>of 5 1000</td>", "<td>rk4 of 8 plants</td>", "<p>20 500 000</p>"):
        assert cells(other) == other
    linked = '<td>a <a href="a 100">1{}100</a></td>'
    assert cells(linked.format(" ")) == linked.format("\xa0")


def test_a_sentence_is_given_room():
    sentence = "A sentence that would stand one word a line."
    assert cells(f"<td>{sentence}</td>") == f'<td class="long">{sentence}</td>'
    short = f'<td><a title="{sentence}">short</a>\n</td>'
    assert cells(short) == short


def test_long_code_is_broken_between_its_words_alone():
    whole = "<td><code>symplectic_euler</code></td>"
    assert cells(whole) == whole
    broken = "symplectic_<wbr>euler_<wbr>implicit_<wbr>damping"
    long = f'<td><code class="long">{broken}</code></td>'
    assert cells(f"<td><code>{broken.replace('<wbr>', '')}</code></td>") == long
