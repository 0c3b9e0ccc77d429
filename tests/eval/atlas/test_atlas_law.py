"""Fits and their errors on points whose law is planted."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from integ_gym.envs import Discretization
from integ_gym.eval.atlas.numbers import CANDIDATES, GUESSES, Quantities, terms_of
from integ_gym.eval.atlas.numbers.quantities import LEAST_SPARE
from integ_gym.eval.atlas.prediction import Curve, Line, fit, off_by_chance, trials
from integ_gym.eval.atlas.summaries import Point

RATIOS = (1.0, 1.5, 2.0, 3.0)
HOMES = [
    Discretization(name, dt, 0.05)
    for name in ("explicit_euler", "rk4", "implicit_euler")
    for dt in (0.05, 0.025, 0.0125)
]


NUMBERS = (
    *("force", "reactive_force", "power", "energy_share", "critical_ratio", "h_omega", "step"),
    *("growth", "inverse_order", "time_to_spare"),
)


def planted(generator, ratios=RATIOS, noise=0.0):
    """Losses that the force decides, and nothing else."""
    found = []
    for ratio in ratios:
        for home in HOMES:
            own = SimpleNamespace(**{name: float(generator.uniform(0.01, 1.0)) for name in NUMBERS})
            loss = min(1.0, max(0.0, own.force - 0.2 + noise * generator.normal()))
            on_truth = np.full(4, 1.0 - loss)
            found.append(Point(ratio, home, own, (0, 1, 2, 3), np.ones(4), on_truth, on_truth))
    return found


def test_the_number_that_decides_predicts_best_what_was_not_seen():
    generator = np.random.default_rng(5)
    seen, unseen = planted(generator), planted(generator, (1.2, 2.5))
    curves = [fit(name, seen) for name in (*CANDIDATES, *GUESSES)]
    errors = {one.number: one.error for one in trials(curves, unseen)}
    assert min(errors, key=errors.__getitem__) == "force of the numerics"
    assert errors["force of the numerics"] < 0.05 < 0.15 < errors["nothing"]


def test_a_loss_of_two_kinds_is_predicted_by_two_numbers():
    """By the reactive force, and by power over time."""
    generator = np.random.default_rng(10)
    seen, unseen = (
        [_of_two_kinds(point, generator) for point in planted(generator, ratios)]
        for ratios in (np.linspace(1.0, 3.0, 16), (1.2, 2.5))
    )
    curves = [fit(name, seen) for name in (*CANDIDATES, *GUESSES)]
    best = min(trials(curves, unseen), key=lambda one: one.error)
    assert best.number == "reactive force, and power over time to spare"
    assert best.error < 0.05
    curve = next(one for one in curves if one.number == best.number)
    for point in unseen:
        parts = curve.parts(point.known)
        assert parts["out of step"] == pytest.approx(_out_of_step(point.known), abs=0.1)
        assert parts["helped"] == pytest.approx(_helped(point.known), abs=0.1)
        assert curve(point.known) == pytest.approx(parts["out of step"] + parts["helped"])


def _of_two_kinds(point, generator):
    own = point.quantities
    own.power *= generator.choice([-1.0, 1.0])
    return replace(point, on_truth=np.full(4, 1.0 - _out_of_step(own) - _helped(own)))


def _out_of_step(own):
    return 0.5 * own.reactive_force


def _helped(own):
    return min(0.5, 0.1 * max(own.power, 0.0) / own.time_to_spare)


def test_no_more_than_all_is_expected_to_be_lost():
    lines = (Line((0.0, 1.0), (0.0, 0.8)), Line((0.0, 1.0), (0.0, 0.7)))
    curve = Curve("reactive force, and power over time to spare", lines, (0.0, 0.1, 0.2), 0.1)
    most = SimpleNamespace(reactive_force=9.0, power=9.0, time_to_spare=0.05)
    assert curve.parts(most) == {"out of step": 0.8, "helped": 0.7}
    assert curve(most) == 1.0


def test_nothing_predicts_the_mean_of_what_was_seen():
    generator = np.random.default_rng(6)
    seen = planted(generator)
    curve = fit("nothing", seen)
    (line,) = curve.lines
    assert line.loss == (pytest.approx(np.mean([point.loss for point in seen])),)


def test_curves_never_fall_and_their_intervals_cover():
    generator = np.random.default_rng(7)
    covered = []
    for _ in range(20):
        curve = fit("force of the numerics", planted(generator, noise=0.1))
        (line,) = curve.lines
        assert list(line.at) == sorted(set(line.at))
        assert list(line.loss) == sorted(line.loss)
        covered.append(trials([curve], planted(generator, noise=0.1))[0].covered)
    assert 0.85 < np.mean(covered) < 0.97


def test_a_loss_is_off_by_what_other_seeds_would_change():
    generator = np.random.default_rng(9)
    kept = np.array([0.75, 1.0])
    for one in kept:
        found = [_of_few_seeds(generator, one) for _ in range(200)]
        within = np.mean([abs(p.loss - (1.0 - one)) <= off_by_chance(p) for p in found])
        assert within > 0.87
    assert np.mean([off_by_chance(point) for point in found]) < 0.15
    alike = replace(found[0], on_truth=np.zeros(16))
    assert 0.0 < off_by_chance(alike) < 0.2


def _of_few_seeds(generator, kept, seeds=16):
    """What succeeds at home succeeds on the truth with one probability."""
    at_home = generator.binomial(20, generator.uniform(0.5, 1.0, seeds))
    on_truth = generator.binomial(at_home, kept) / 20
    return Point(1.0, HOMES[0], None, tuple(range(seeds)), at_home / 20, on_truth, on_truth)


def test_few_seeds_are_covered_by_their_chance_as_well():
    generator = np.random.default_rng(11)
    curve = fit("force of the numerics", planted(generator, noise=0.02))
    few = [_over_seeds(point, generator) for point in planted(generator, noise=0.02)]
    (tried,) = trials([curve], few)
    assert tried.covered < 0.75
    assert 0.8 < tried.with_chance <= 1.0


def _over_seeds(point, generator):
    spread = generator.normal(0.0, 0.1, 4)
    return replace(point, on_truth=np.clip(point.on_truth + spread, 0.0, 1.0))


def test_intervals_are_apart_where_the_numerics_do_next_to_nothing():
    generator = np.random.default_rng(12)
    found = planted(generator, noise=0.1)
    for point in found[::3]:
        point.quantities.force = 0.01
    found[::3] = [replace(point, on_truth=np.ones(4)) for point in found[::3]]
    curve = fit("nothing", found)
    assert curve.half_widths[0] < curve.half_widths[2]
    forces, expected = np.array([(p.known.force, curve(p.known)) for p in found]).T
    widths = curve.half_width(forces, expected)
    assert set(widths[::3]) == {curve.half_widths[0]}
    assert set(widths[1::3]) == {curve.half_widths[2]}


def test_an_error_lies_in_its_interval():
    generator = np.random.default_rng(8)
    seen, unseen = planted(generator), planted(generator, (1.7,))
    best, power = trials(
        [fit(f"{one} of the numerics", seen) for one in ("force", "power")], unseen
    )
    assert power.low < power.error < power.high
    assert power.points == best.points == len(HOMES)
    assert (best.more, best.more_low, best.more_high) == (0.0, 0.0, 0.0)
    assert power.more == pytest.approx(power.error - best.error)
    assert 0.0 < power.more_low < power.more < power.more_high


def test_policies_that_learned_nothing_are_left_out():
    generator = np.random.default_rng(9)
    seen = planted(generator)
    failed = [
        Point(p.ratio, p.home, p.quantities, p.seeds, 0 * p.at_home, *2 * (p.on_truth,))
        for p in seen
    ]
    assert fit("force of the numerics", seen + failed) == fit("force of the numerics", seen)
    with pytest.raises(ValueError, match="no policy learned"):
        fit("force of the numerics", failed)


def test_numbers_of_known_discretizations():
    """Explicit Euler pumps, implicit Euler drains, the truth is the truth."""
    given = {"start": "hanging", "duration": 10.0, "max_torque": 0.714}
    own = {
        name: Quantities("IntegPendulum-v0", given, Discretization(name, 0.05, 0.05))
        for name in ("explicit_euler", "implicit_euler", "reference")
    }
    assert own["reference"].margin == pytest.approx(1.7, abs=1e-3)
    assert own["reference"].critical_ratio == 1.0
    for name in ("force", "power", "growth", "energy_share"):
        assert abs(getattr(own["reference"], name)) < 1e-9
    assert own["explicit_euler"].critical_ratio < 0.2 < 1.0 < own["implicit_euler"].critical_ratio
    assert own["explicit_euler"].power > 0.5 > -0.5 > own["implicit_euler"].power
    assert terms_of("order alone")[0].number(own["explicit_euler"]) == 1.0


def test_numerics_that_give_and_take_back_have_a_reactive_force_alone():
    given = {"start": "hanging", "max_torque": 0.714}
    symplectic, explicit = (
        Quantities(
            "IntegPendulum-v0", {**given, "duration": 10.0}, Discretization(name, 0.05, 0.05)
        )
        for name in ("symplectic_euler", "explicit_euler")
    )
    assert symplectic.reactive_force == pytest.approx(symplectic.force, rel=0.01)
    assert explicit.reactive_force < 0.01 * explicit.force


def test_time_to_spare_is_what_swing_up_and_stay_leave():
    given = {"start": "hanging", "max_torque": 0.714}
    at = Discretization("rk4", 0.05, 0.05)
    short, long, hopeless = (
        Quantities("IntegPendulum-v0", {**given, "duration": duration}, at).time_to_spare
        for duration in (10.0, 18.0, 4.0)
    )
    swing_up = 8.0 / (short + 1.0)
    assert 5.0 < swing_up < 7.0
    assert long == pytest.approx(16.0 / swing_up - 1.0)
    assert hopeless == LEAST_SPARE
