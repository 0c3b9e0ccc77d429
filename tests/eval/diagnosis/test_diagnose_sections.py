"""What holds of sections on every plant: orders are judged, rollouts recorded, NaN is no number."""

import numpy as np
import pytest
from examining import MOVING, RESTING, examine, lines, verdicts
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text
from touching import Puck, Rod

from integ_gym.envs.engines.stepping import NativeEngine
from integ_gym.envs.numerics import stepping
from integ_gym.envs.numerics.accuracy import independent_motion
from integ_gym.envs.numerics.stepping import advance
from integ_gym.envs.plants.hopper import Hopper
from integ_gym.envs.registries import INTEGRATORS, TRUTH
from integ_gym.eval.diagnosis import control
from integ_gym.eval.diagnosis.bench import Bench
from integ_gym.eval.diagnosis.contact import diagnose_contact
from integ_gym.eval.diagnosis.figures import FIGURES, NARROWEST, draw_contact, schemes_of
from integ_gym.eval.diagnosis.lines import Diagnosis
from integ_gym.eval.diagnosis.subject import Subject, subjects
from integ_gym.evidence.store import EvidenceStore

NAMES = [name for name in INTEGRATORS.names() if name != TRUTH]
WITH_ORDERS = ("free motion", "damping", "friction", "contact", "actuation", "timestep refinement")
ORDERED = ("pendulum", "elastic_pendulum", "cart_pole")
"""Plants whose orders these are: the first and the last have friction and stops."""


@pytest.mark.parametrize("place", range(len(NAMES)))
def test_the_order_of_every_integrator_is_judged_and_right(place, tmp_path, monkeypatch):
    """Every section and integrator at least once.

    Orders of every integrator on every plant are measured in `test_integrators.py` and
    `test_accuracy.py`; here it is asked whether a section finds and judges them.
    """
    monkeypatch.setattr(control, "success", lambda *arguments: None)
    section, plant = WITH_ORDERS[place % len(WITH_ORDERS)], ORDERED[place % len(ORDERED)]
    findings = examine(section, plant, NAMES[place], TRUTH, store=tmp_path)
    judged = [f for f in findings if f.order_steps]
    for finding in judged:
        assert finding.holds is True, finding
        assert finding.order_steps[-1] <= finding.steps[-1]
    assert {f.integrator for f in judged} == {NAMES[place]}
    assert all(f.holds for f in findings if f.integrator == TRUTH)


@pytest.mark.slow
@pytest.mark.parametrize("plant", MOVING)
def test_what_never_rests_is_diagnosed_without_its_rest(plant, tmp_path, monkeypatch):
    monkeypatch.setattr(control, "success", lambda *arguments: None)
    findings = []
    for section in ("plant", "integrator", "actuation", "timestep refinement", "latency"):
        findings += examine(section, plant, "stormer_verlet", TRUTH, store=tmp_path / section)
    assert {f.holds for f in findings} - {None} == {
        True
    }  # a clock, and a torso in the air, have rounding alone
    assert lines(findings, "control − command")
    assert lines(findings, "delayed commands")


@pytest.mark.parametrize(
    ("name", "plant"), [("touching:Puck", Puck()), ("touching:Rod", Rod()), ("hopper", Hopper())]
)
def test_a_landing_is_held_against_the_truth(name, plant, tmp_path):
    start = stepping.probe_state(plant)
    subject = Subject(name, plant, (), (0.0005, 0.00025), start, 1.0, 1.0, rests=False)
    bench = Bench(EvidenceStore(tmp_path), "test")
    diagnosis = Diagnosis("contact", bench, subject, ("rk4", TRUTH))
    diagnose_contact(diagnosis)
    assert verdicts(diagnosis.findings, "lands, largest penetration") == {True}
    assert verdicts(diagnosis.findings, "energy that the plane takes") == {True}
    assert verdicts(diagnosis.findings, "energy residual", TRUTH) == {True}
    assert len(lines(diagnosis.findings, "largest penetration")) == len(plant.contact_names)


@pytest.mark.parametrize("plant", RESTING)
def test_truth_is_known_to_the_same_digits_by_scipy(plant):
    (subject,) = subjects(None, plant, [])
    controls = np.sin(np.arange(30.0))
    motion = independent_motion(subject.plant, subject.start, controls, subject.control_period)
    state = subject.start
    for command in controls:
        state = advance("reference", subject.plant, state, subject.control_period, 1, command)
    assert np.abs(state - motion.states[-1]).max() < 1e-10
    assert np.abs(motion.lost).max() < 1e-10 * motion.energy.max()
    assert np.abs(motion.work).max() > 1e-3 * motion.energy.max()


@pytest.mark.parametrize("section", ["integrator", "damping"])
def test_every_step_of_every_rollout_is_in_a_record(section, tmp_path, monkeypatch):
    """Only single steps are taken beside the records."""
    steps, probes = [], []

    def counting(self, ops, q, v, segments, sample_at):
        steps.append(np.size(q[0]) * sum(count for _, count in segments))
        return whole(self, ops, q, v, segments, sample_at)

    def probing(integrator, plant, states, *more):
        probes.append(len(states))
        return one_step(integrator, plant, states, *more)

    monkeypatch.setattr("integ_gym.envs.steps.WARM_UP", 10**9)
    monkeypatch.setattr(
        "integ_gym.envs.environment.WARM_UP", 10**9
    )  # traced steps do not call the engine
    whole, one_step = NativeEngine.advance, stepping.advance_lanes
    monkeypatch.setattr(NativeEngine, "advance", counting)
    for module in ("accuracy", "stepping"):
        monkeypatch.setattr(f"integ_gym.envs.numerics.{module}.advance_lanes", probing)
    monkeypatch.setattr("integ_gym.envs.numerics.advance_lanes", probing)
    examine(section, "pendulum", "implicit_midpoint", store=tmp_path)
    recorded = EvidenceStore(tmp_path).query("SELECT sum(length * substeps) AS n FROM records")
    assert sum(steps) - sum(probes) == recorded.to_pylist()[0]["n"] > 1000


def test_a_plant_of_ones_own_goes_through_every_section(tmp_path):
    """Damped as it stands, without a task, a stop or friction."""
    findings = examine("integrator", "planted:Slider", "stormer_verlet", store=tmp_path / "a")
    assert verdicts(findings, "order") == {True}
    assert verdicts(findings, "symplectic, max") == {True}
    assert verdicts(findings, "reversible, ") == {True}
    findings = examine("free motion", "planted:Slider", "stormer_verlet", store=tmp_path / "b")
    assert {f.holds for f in findings} == {True}
    (drift,) = lines(findings, "energy change after")
    assert drift.expectation.expected == "bounded"
    for section in ("plant", "stiffness", "damping", "actuation", "timestep refinement", "latency"):
        found = examine(section, "planted:Slider", "stormer_verlet", store=tmp_path / section)
        assert found
        assert {f.holds for f in found} == {True}, section
        assert {f.unit for f in found} <= {"", "J", "N", "s", "m"}
    for section in ("friction", "contact"):
        assert examine(section, "planted:Slider", "rk4", store=tmp_path / section) == []


def test_steps_so_fine_that_errors_are_rounding_are_not_judged(tmp_path):
    names, steps = ("rk4", "symplectic_euler"), [0.0005, 0.00025]
    findings = examine("actuation", "pendulum", *names, steps=steps, store=tmp_path)
    (work,) = lines(findings, "work booked", "rk4")
    assert work.holds is None
    assert "nothing but rounding" in work.expectation.expected
    assert verdicts(findings, "work booked", "symplectic_euler") == {True}


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
