"""Figures of a diagnosis: nothing is empty, cut off or on top of something else, on a phone too."""

from __future__ import annotations

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

from integ_gym.eval.diagnosis.figures import FIGURES, NARROWEST, draw_contact, schemes_of

ALL = ("explicit_euler", "implicit_euler", "implicit_midpoint", "rk4", "stormer_verlet",
       "symplectic_euler", "reference")  # fmt: skip
THREE = ("cart_pole", "elastic_pendulum", "my_module:Slider")


@pytest.fixture
def curves(diagnosis):
    """Curves as they would be of other plants and more integrators: only the names differ."""
    _, result, _ = diagnosis

    def of(key, integrators, plants):
        drawn = result["curves"][key]
        had = {c["integrator"]: c for c in drawn}
        names = list(dict.fromkeys((*integrators, "reference")))
        found = [
            {**had.get(name, had["symplectic_euler"]), "integrator": name, "plant": plant}
            for plant in plants
            for name in names
        ]
        return [c for c in found if key != "contact" or c["integrator"] != "reference"]

    return of


@pytest.mark.parametrize(
    ("names", "plants"),
    [(("reference",), ("pendulum",)), (("planted:Silent",), THREE), (ALL, THREE)],
)
def test_figures(names, plants, curves):
    schemes = schemes_of(names)
    for key, draw in FIGURES.values():
        figure = draw(curves(key, names, plants), schemes)
        _check(figure)
        assert "reference" in {text.get_text() for text in figure.findobj(Text)}
    if schemes:
        figure = draw_contact(curves("contact", names, plants[:1]), schemes)
        _check(figure)
        maps = [axes for axes in figure.axes if axes.get_xscale() == "log"]
        assert len(maps) == 3 * len(schemes)


def _check(figure) -> None:
    """Every plot shows something, and no text is cut off or overlaps another."""
    FigureCanvasAgg(figure).draw()
    assert figure.get_size_inches()[0] >= NARROWEST - 1e-9
    texts = []
    for axes in figure.axes:
        if axes.get_visible():
            assert axes.lines or axes.collections or axes.texts
            titles = (axes.title, axes._left_title)
            texts += [*titles, axes.xaxis.label, axes.yaxis.label, *axes.texts]
    renderer = figure.canvas.get_renderer()
    boxes = [(t.get_text(), t.get_window_extent(renderer)) for t in texts if t.get_text()]
    whole = figure.bbox
    for text, box in boxes:
        assert whole.x0 <= box.x0 < box.x1 <= whole.x1, text
        assert whole.y0 <= box.y0 < box.y1 <= whole.y1, text
    for i, (text, box) in enumerate(boxes):
        for other, place in boxes[i + 1 :]:
            assert not box.overlaps(place), (text, other)
    filled = max(axes.get_position().x1 for axes in figure.axes if axes.get_visible())
    assert filled > 0.7
