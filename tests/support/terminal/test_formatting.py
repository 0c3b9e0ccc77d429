"""Numbers as text, and as colours."""

from __future__ import annotations

import matplotlib
import numpy as np
import pytest

from integ_gym.support.figures import ink_on, success_colour
from integ_gym.support.terminal import (
    compact,
    compact_percent,
    fixed,
    nonbreaking,
    percent,
    seconds,
)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (8.04, "+8.0"),
        (0.0995, "+0.10"),
        (-13.2, "−13"),
        (1234.0, "+1200"),
        (-3.04e-12, "−3.0·10⁻¹²"),
        (0.0, "0"),
        (None, "–"),
        (float("nan"), "–"),
    ],
)
def test_numbers_keep_two_digits(value: float | None, text: str) -> None:
    assert compact(value, 2, True) == text


def test_numbers_have_true_minus_signs_and_no_negative_zero() -> None:
    assert fixed(-0.25) == "−0.25"
    assert fixed(-0.001) == "0.00"
    assert fixed(0.001, sign=True) == "0.00"
    assert [seconds(value) for value in (0.25, 61.0, 7260.0, None)] == [
        "0.25 s", "1 min 1 s", "2 h 1 min", "–",
    ]  # fmt: skip


def test_shares_are_told_in_per_cent() -> None:
    assert [percent(0.536), percent(0.0042, 1, sign=True), percent(None)] == ["54 %", "+0.4 %", "–"]
    told = [compact_percent(share, sign=True) for share in (-4.1e-8, 1.73, float("nan"))]
    assert told == ["−4.1·10⁻⁶ %", "+170 %", "–"]


def test_the_sign_of_a_per_cent_stays_with_its_number() -> None:
    assert nonbreaking("in 54 % of 3 cases") == "in 54\N{NO-BREAK SPACE}% of 3 cases"


def test_success_colours_are_viridis_and_their_text_is_legible() -> None:
    for rate in np.linspace(0.0, 1.0, 101):
        colour = success_colour(float(rate))
        mapped = matplotlib.colormaps["viridis"](float(rate))[:3]
        assert np.allclose(matplotlib.colors.to_rgb(colour), mapped, atol=0.02)
        light, dark = sorted(map(luminance, (colour, ink_on(colour))), reverse=True)
        assert (light + 0.05) / (dark + 0.05) >= 4.5


def luminance(colour: str) -> float:
    """Relative luminance as the web's contrast rules define it."""
    channels = np.array(matplotlib.colors.to_rgb(colour))
    linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])
