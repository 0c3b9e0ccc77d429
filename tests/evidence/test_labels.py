"""Failure labels: every rule, that the first one that fits is taken, and the sentences.

Planted causes get their label, whatever else is random. They are planted without the rules' own
code: of everything else, a kind lets vary all that may not change its label, and holds back only
what a rule before its own would take it for.
"""

import json
import re
from collections import Counter

import numpy as np
import pytest

from integ_gym.evidence.fields import CELL_STATUSES, LABELS, SUMMARY_FIELDS
from integ_gym.evidence.labels import (
    REASONS,
    EpisodeFacts,
    Replays,
    failure_label,
    failure_sentence,
)

RECORD = {
    "metric_definition": "|theta| < 0.2 rad",
    "engine": "native",
    "integrator": "rk4",
    "dt": 0.05,
    "control_period": 0.05,
    "terminated": False,
}


COUNT = 100
UNKNOWN_OR_FALSE = (None, False)
ELSEWHERE = (False, "is home", "no home")
SOLVED = tuple(status for status in (None, *CELL_STATUSES) if status != "unachievable")


class _Planter:
    """Draws facts and replays of one failed episode, and plants a cause in them."""

    def __init__(self, rng):
        self.rng = rng
        time = float(rng.uniform(0.5, 30.0))
        reached = self.one_of(None, float(rng.uniform(0.0, time)))
        self.facts = {
            "success": False,
            "time": time,
            "episode_return": float(rng.normal(0.0, 100.0)),
            "solver_status": self.one_of("ok", "not_converged", "not_reported"),
            "saturated_share": float(rng.uniform(0.0, 1.0)),
            "goal_reached": reached,
            "goal_left": None if reached is None else self.one_of(None, (reached + time) / 2.0),
            "goal_since": self.one_of(None, float(rng.uniform(0.0, time))),
            "observation_noise": self.one_of(0.0, float(rng.uniform(1e-3, 1.0))),
            "staleness": self.one_of(0.0, float(rng.uniform(1e-3, 1.0))),
            "homes": int(rng.integers(1, 4)),
        }
        self.replays = {
            "home": self.one_of(None, True, *ELSEWHERE),
            "without_noise": self.one_of(None, True, False),
            "without_delay": self.one_of(None, True, False),
            "second_horizon": self.one_of(None, True, False),
            "home_success": self.one_of(None, float(rng.uniform(0.0, 1.0))),
            "cell_status": self.one_of(None, *CELL_STATUSES),
            "contract_kept": self.one_of(None, True),
        }

    def one_of(self, *choices):
        return choices[self.rng.integers(len(choices))]

    def evaluation_error(self):
        self.facts["success"] = self.one_of(True, False)
        broken = self.one_of({"solver_status": "diverged"}, {"episode_return": None})
        self.facts.update(broken)

    def none(self):
        self.facts["success"] = True

    def contract_error(self):
        self.replays["contract_kept"] = False

    def unachievable(self):
        self.replays["cell_status"] = "unachievable"

    def not_learned(self):
        self.replays["cell_status"] = self.one_of(*SOLVED)
        self.replays["home_success"] = float(self.rng.uniform(0.0, 0.499))

    def _learned(self):
        self.replays["cell_status"] = self.one_of(*SOLVED)
        self.replays["home_success"] = self.one_of(None, float(self.rng.uniform(0.5, 1.0)))

    def too_slow(self):
        self._learned()
        self.replays["second_horizon"] = True

    def _lost_here(self):
        self._learned()
        self.replays["second_horizon"] = self.one_of(*UNKNOWN_OR_FALSE)

    def discretization_error(self):
        self._lost_here()
        self.replays["home"] = True

    def _lost_at_home_too(self):
        self._lost_here()
        self.replays["home"] = self.one_of(*ELSEWHERE)

    def perception_error(self):
        self._lost_at_home_too()
        self.facts["observation_noise"] = float(self.rng.uniform(1e-3, 1.0))
        self.replays["without_noise"] = True

    def _lost_without_noise_too(self):
        self._lost_at_home_too()
        if self.facts["observation_noise"]:
            self.replays["without_noise"] = False

    def state_error(self):
        self._lost_without_noise_too()
        self.facts["staleness"] = float(self.rng.uniform(1e-3, 1.0))
        self.replays["without_delay"] = True

    def _lost_undisturbed(self):
        self._lost_without_noise_too()
        if self.facts["staleness"]:
            self.replays["without_delay"] = False

    def control_error(self):
        self._lost_undisturbed()
        cause = self.one_of("saturated", "left", "both")
        self.facts["saturated_share"] = float(
            self.rng.uniform(0.0, 0.499) if cause == "left" else self.rng.uniform(0.5, 1.0)
        )
        left = {"goal_reached": 0.25 * self.facts["time"], "goal_left": 0.5 * self.facts["time"]}
        self.facts.update({"goal_left": None} if cause == "saturated" else left)

    def planning_error(self):
        self._lost_undisturbed()
        self.facts["saturated_share"] = float(self.rng.uniform(0.0, 0.499))
        self.facts["goal_left"] = None

    def unattributed(self):
        unknown = self.one_of("home", "without_noise", "without_delay")
        if unknown == "home":
            self._lost_here()
        elif unknown == "without_noise":
            self._lost_at_home_too()
            self.facts["observation_noise"] = float(self.rng.uniform(1e-3, 1.0))
        else:
            self._lost_without_noise_too()
            self.facts["staleness"] = float(self.rng.uniform(1e-3, 1.0))
        self.replays[unknown] = None


def _planted(kind, seed):
    planter = _Planter(np.random.default_rng([seed, LABELS.index(kind)]))
    getattr(planter, kind)()
    return EpisodeFacts(**planter.facts), Replays(**planter.replays)


@pytest.mark.parametrize("kind", LABELS)
def test_a_planted_cause_is_found(kind):
    failures = [failure_label(*_planted(kind, seed)) for seed in range(COUNT)]
    assert Counter(failure.label for failure in failures) == {kind: COUNT}
    for failure in failures:
        assert failure.reason in REASONS
        assert json.loads(failure.columns()["failure_numbers"]) == failure.numbers
        assert re.fullmatch(r"[^{}]+[^.]\.", failure_sentence({**RECORD, **failure.columns()}))


@pytest.mark.parametrize("home", [True, False, None, "is home", "no home"])
def test_every_field_of_replays_is_a_column(home):
    """Where the episode ran at home, or has none, there was no replay at home."""
    said = Replays(home, True, False, True, 0.75, "undecided", False)
    own = home if isinstance(home, bool) else None
    assert list(said.columns().values()) == [own, True, False, True, 0.75, "undecided", False]
    names = [field.name for field in SUMMARY_FIELDS if field.group == "replays"]
    assert list(said.columns()) == names
