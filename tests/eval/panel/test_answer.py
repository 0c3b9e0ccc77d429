"""The answer's first line says home, truth, loss and cause; the rest and what to do follow."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import msgspec
import numpy as np
import pytest
from known_outcomes import matrix_of, panel_of

from integ_gym.envs.settings import Discretization
from integ_gym.eval.panel.achieve import Tried
from integ_gym.eval.panel.cells import Cell
from integ_gym.eval.panel.conclusions import (
    NextStep,
    finding_of,
    next_step,
)
from integ_gym.eval.panel.matrix import PanelLayout
from integ_gym.eval.panel.result import Look, Panel, Policy, Row
from integ_gym.eval.verdict import Search

HOME = Discretization("symplectic_euler", 0.05, 0.05)
FINER = Discretization("symplectic_euler", 0.025, 0.05)
RK4 = Discretization("rk4", 0.05, 0.05)
TRUTH = Discretization("reference", 0.05, 0.05)
HEAVY = "mass +20 %"
SOLVED = Tried((1.0,), (1.0,))
UNREACHED = Tried((0.0,), (0.0,), Search(20.0, 10.0, (1.0,), "planted"))


def judged(
    success: Mapping[str, float],
    returns: Mapping[str, float] | None = None,
    *,
    home: Discretization | None = HOME,
    truth: bool = True,
    starts: int = 50,
    command: str = "integ-gym evaluate mine.zip --env IntegPendulum-v0 --out runs/mine",
    changed: Mapping[str, Any] = MappingProxyType({"mass": 1.2}),
    tried: Tried = SOLVED,
) -> Panel:
    """An evaluation of one policy; what is not given is as at home.

    ``tried`` is what others reach on the truth.
    """
    discretizations = [HOME, FINER, RK4, *([TRUTH] if truth else [])]
    cells = {d.name: Cell.of(d, "reference" if d == TRUTH else "grid") for d in discretizations}
    heavy = Cell.of(
        HOME,
        "varied",
        name=f"{HOME.name}, {HEAVY}",
        environment=dict(changed),
        variation=HEAVY,
        at=HOME.name,
    )
    cells[heavy.name] = heavy
    rows = (
        Row.of("mine", "given", [Policy(id="mine")], home),
        Row.of("random", "baseline", [Policy(id="random")]),
    )
    noise = np.linspace(-1.0, 1.0, starts)
    earned = {**dict.fromkeys(cells, -10.0), **(returns or {})}
    rates = {**dict.fromkeys(cells, success[HOME.name]), **success}

    def outcome(row, cell, _, k):
        mine = row.name == "mine"
        return {
            "success": mine and k < round(rates[cell] * starts),
            "return": (earned[cell] if mine else -110.0) + noise[k],
        }

    layout = PanelLayout(
        rows, cells, {row.name: tuple(cells) for row in rows}, TRUTH.name if truth else None,
        tried={TRUTH.name: tried},
    )  # fmt: skip
    spec = {"env_id": "IntegPendulum-v0", "environment": {"max_torque": 0.7}}
    matrix = matrix_of(layout, starts, outcome)
    return panel_of(layout, matrix, name="evaluate mine", command=command, spec=spec)


def step_of(panel: Panel) -> NextStep:
    step = next_step(panel)
    assert step is not None
    return step


@pytest.mark.parametrize(
    ("there", "returned", "told", "status"),
    [
        (1.0, -10.0, {}, "not_cause"),
        (0.4, -60.0, {}, "cause"),
        (0.1, -10.0, {"tried": UNREACHED}, "closed"),
        (0.1, -10.0, {"tried": Tried((0.0,), (1.0,))}, "closed"),
        (0.1, -10.0, {"tried": Tried()}, "closed"),
        (0.0, -60.0, {"here": 0.0, "tried": Tried()}, "cause"),
        (0.0, -60.0, {"here": 0.0, "tried": UNREACHED}, "closed"),
        (0.98, -10.0, {"starts": 400}, "not_cause"),
        (0.67, -10.0, {"starts": 3}, "undecided"),
        (0.9, -10.0, {"here": 0.4}, "gained"),
        (0.4, -10.0, {"home": None}, "home_unknown"),
        (1.0, -10.0, {"home": TRUTH}, "home_decides"),
        (1.0, -40.0, {"truth": False}, "cause"),
        (1.0, -10.5, {"truth": False}, "not_cause"),
        (1.0, -10.0, {"truth": False, "home": FINER}, "home_decides"),
    ],
)
def test_what_is_found_of_home_and_truth(
    there: float, returned: float, told: dict[str, Any], status: str
) -> None:
    told = dict(told)
    where = TRUTH.name if told.get("truth", True) else FINER.name
    panel = judged({HOME.name: told.pop("here", 1.0), where: there}, {where: returned}, **told)
    assert panel.answer.startswith(panel.headline)
    found = finding_of(panel)
    assert (found.status, found.cell) == (status, where)
    if status == "closed":
        assert next_step(panel) is None


@pytest.mark.parametrize(("starts", "decided"), [(4, False), (40, True)])
def test_a_variation_that_seems_to_lose_much_is_named_and_asks_for_more_starts(
    starts: int, decided: bool
) -> None:
    varied = f"{HOME.name}, {HEAVY}"
    panel = judged({HOME.name: 1.0}, {varied: -100.0}, truth=False, starts=starts)
    found = finding_of(panel)
    assert found is not None
    assert found.status == "not_cause"
    assert f"{'Largest' if decided else 'Undecided, and not small'}: {varied} lost" in panel.answer
    step = next_step(panel)
    assert (step is not None and "more starts" in step.purpose) == (not decided)


def test_the_next_command_checks_the_step_or_asks_for_what_is_missing() -> None:
    """Half the step where success is lost; the same with other seeds where none is."""
    for there, dt in ((0.4, "0.025"), (1.0, "0.05")):
        assert step_of(judged({HOME.name: 1.0, TRUTH.name: there})).command == (
            "integ-gym check --env IntegPendulum-v0 --integrator symplectic_euler "
            f"--dt {dt} --control-period 0.05 --env-arg max_torque=0.7"
        )
    panel = judged({HOME.name: 1.0, TRUTH.name: 0.4})
    others = msgspec.structs.replace(panel, spec={**panel.spec, "env_id": "Hopper-v5"})
    assert "check" not in step_of(others).command, "which would train for long"
    few = {HOME.name: 1.0, TRUTH.name: 0.67}
    panel = judged(few, starts=3)
    assert step_of(panel).command == f"{panel.command} --episodes 12", "which counts its looks"
    again = judged(few, starts=3, command=f"{panel.command} --episodes 3 --no-progress")
    assert step_of(again).command == f"{panel.command} --no-progress --episodes 12"
    python = judged(few, starts=3, command="integ_gym.evaluate")
    assert step_of(python).command == "integ_gym.evaluate(…, episodes=12)"
    finest = judged({HOME.name: 1.0}, truth=False, home=FINER)
    assert step_of(finest).command.endswith("--out runs/mine --dt 0.05 --dt 0.025 --dt 0.0125")
    unknown = judged({HOME.name: 1.0, TRUTH.name: 0.4}, home=None)
    assert step_of(unknown).command.endswith("--home integrator=…,dt=…,control_period=…")
    look = Look(seeds=1, episodes=50, natives=0, level_exceeds=0.0, level_equivalent=0.0)
    step = step_of(msgspec.structs.replace(unknown, looks=(look, look)))
    assert step.purpose.endswith("; this was look 2, and all of them count there too")


@pytest.mark.parametrize(
    ("returned", "said"),
    [(-10.5, "the engine is not the cause."), (-40.0, "the engine is the cause.")],
)
def test_another_engine_at_the_same_step_is_not_called_a_step(returned: float, said: str) -> None:
    panel = judged({HOME.name: 1.0}, {FINER.name: returned}, truth=False)
    cells = [
        msgspec.structs.replace(cell, dt=HOME.dt, engine="mujoco")
        if cell.name == FINER.name
        else cell
        for cell in sorted(panel.cells, key=lambda cell: cell.name != FINER.name)
    ]
    same = msgspec.structs.replace(panel, cells=tuple(cells))
    assert f", at the finest step ({FINER.name}) " in panel.headline
    assert f", in {FINER.name} " in same.headline
    assert same.headline.endswith(said)


def test_what_loses_most_elsewhere_stands_behind_a_clean_answer() -> None:
    """A discretization that can be won and loses half or more, not a perturbation."""
    clean = {HOME.name: 1.0, TRUTH.name: 1.0, RK4.name: 0.1}
    assert judged(clean).headline.endswith("but on rk4 dt=0.05 it loses 0.90.")
    home = judged({TRUTH.name: 1.0, HOME.name: 1.0, RK4.name: 0.1}, home=TRUTH)
    assert home.headline.endswith("but on rk4 dt=0.05 it loses 0.90.")
    finest = judged({HOME.name: 1.0}, {RK4.name: -100.0}, truth=False, home=FINER)
    assert ", and home is the finest step here, so whether dt is the cause" in finest.headline
    assert "is unknown; but on rk4 dt=0.05 it loses " in finest.headline
    heavy = f"{HOME.name}, {HEAVY}"
    for other in ({RK4.name: 0.7}, {heavy: 0.0}):
        assert judged({**clean, RK4.name: 1.0, **other}).headline.endswith("dt is not the cause.")
    solver = judged({**clean, RK4.name: 1.0, heavy: 0.0}, changed={"solver": {"iterations": 1}})
    assert solver.headline.endswith(f"but on {heavy} it loses 1.00.")
