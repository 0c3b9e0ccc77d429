"""Two environments compared before they integrate: planted faults, and engines that are equal."""

import json
import shutil

import gymnasium as gym
import numpy as np
import pytest
from faulty_hoppers import FAULTS, register
from house import page_blocks

import integ_gym
from integ_gym.cli import main
from integ_gym.envs.engines.stepping import NativeEngine, missing_modules
from integ_gym.envs.registries import ENGINES
from integ_gym.envs.testbeds.boundaries import Boundaries
from integ_gym.envs.testbeds.gym_testbed import Applied
from integ_gym.eval.contract import (
    SIDES,
    TOLERANCE,
    BoundaryCheck,
    Contract,
    compare_boundaries,
    compare_contracts,
)
from integ_gym.eval.panel.conclusions import contract_words
from integ_gym.eval.power import Comparison, judge_family
from integ_gym.eval.verdict import Achieved, Attempt, Rates

HOPPER = "Hopper-v5"


@pytest.mark.parametrize("kind", FAULTS, ids=lambda kind: kind.__name__)
def test_a_fault_is_named_at_its_own_boundary_alone(kind) -> None:
    boundary, components = FAULTS[kind]
    (check,) = compare_contracts(HOPPER, register(kind)).broken
    assert check.boundary == boundary
    named = {one.component for one in check.differing}
    assert components <= named
    if boundary != "acceleration":  # which all joints have a part in
        assert named == components


def test_numbers_are_those_of_both_environments() -> None:
    kind = next(kind for kind in FAULTS if kind.__name__ == "OtherGear")
    (check,) = compare_contracts(HOPPER, register(kind)).broken
    (gear,) = check.differing
    assert gear.second == pytest.approx(1.1 * gear.first)
    assert gear.relative == pytest.approx(0.1 / 1.1)
    assert check.largest == gear.relative > check.tolerance


@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicit", "implicitfast", "discrete"])
def test_integrator_and_step_are_no_fault(integrator: str) -> None:
    found = compare_contracts("dt=0.002", f"integrator={integrator},dt=0.001", HOPPER)
    assert not found.broken
    assert all(check.compared and check.largest == 0.0 for check in found.checks)


COMPILED = ("mjx", "mujoco_warp", "newton")
"""Engines that take many seconds to compile, and give a step alone."""

INSTALLED = [name for name in ENGINES.names() if not missing_modules(name)]


@pytest.mark.parametrize("env_id", ["IntegPendulum-v0", "IntegCartPoleSwingUp-v0"])
@pytest.mark.parametrize("engine", sorted({*INSTALLED} - {"native", *COMPILED}))
def test_engines_keep_the_contract_or_say_what_they_cannot(engine: str, env_id: str) -> None:
    found = compare_contracts("dt=0.02", f"engine={engine},dt=0.02", env_id)
    *others, acceleration = found.checks
    assert not found.broken
    assert all(check.compared for check in others)
    tells = engine in ("mujoco", "drake", "pinocchio", "casadi", "dart")
    assert acceleration.compared == tells
    assert acceleration.silent == (() if tells else SIDES[1:])


def test_a_testbed_that_has_no_state_is_compared_at_starts(tmp_path) -> None:
    found = compare_contracts("dt=0.2", "dt=0.1", "Acrobot-v1")
    assert found.starts_alone
    assert [check.boundary for check in found.checks if check.compared] == [
        "observation",
        "command",
    ]
    assert not found.broken


class Rescaled(integ_gym.GymTestbed):
    """Gymnasium's pendulum, which observes its speed in revolutions and halves its actions."""

    home = integ_gym.Discretization("symplectic_euler", 0.05, 0.05, "gymnasium")
    choices = ("symplectic_euler",)

    def build(self, discretization, **arguments):
        env = gym.make("Pendulum-v1", **arguments)
        env = gym.wrappers.TransformObservation(
            env, lambda shown: shown * np.float32([1, 1, 1 / (2 * np.pi)]), env.observation_space
        )
        halved = gym.wrappers.TransformAction(env, lambda action: action / 2, env.action_space)
        return self.held(halved, discretization, rewards="rate")

    def read(self, env):
        return self.as_applied("symplectic_euler", env.unwrapped.dt, env)


def test_a_wrapper_of_ones_own_testbed_is_seen() -> None:
    found = compare_contracts("Pendulum-v1", f"{__name__}:Rescaled")
    told = {check.boundary: [one.component for one in check.differing] for check in found.broken}
    assert told == {"observation": ["obs2"], "command": ["action0"]}


class Normalized(Rescaled):
    """A hopper whose observations are normalized by what was seen before."""

    home = integ_gym.Discretization("RK4", 0.002, 0.008, "mujoco")
    choices = ("RK4",)

    def build(self, discretization, **arguments):
        return gym.wrappers.NormalizeObservation(gym.make(HOPPER))

    def read(self, env):
        return Applied(self.home, 4)


def test_an_environment_with_running_statistics_is_the_same_as_itself() -> None:
    assert not compare_contracts(*2 * [f"{__name__}:Normalized"]).broken


def test_actions_that_cannot_be_drawn_are_refused() -> None:
    env = gym.wrappers.TransformAction(
        gym.make("CartPole-v1"), lambda action: action[0], gym.spaces.MultiDiscrete([2, 3])
    )
    with pytest.raises(integ_gym.IntegGymError, match="Box or Discrete"):
        compare_boundaries(["one", "other"], [Boundaries(env), Boundaries(env)])


class Told(Rescaled):
    """Gymnasium's pendulum as it is, which says all by the document's example."""

    def build(self, discretization, **arguments):
        return self.held(gym.make("Pendulum-v1", **arguments), discretization, rewards="rate")

    def boundaries(self, environments):
        found: dict = {}
        blocks = page_blocks("docs/how-to/testbeds.md", "python")
        exec(next(block for block in blocks if block.startswith("# my_boundaries.py")), found)
        return found["PendulumBoundaries"](environments.unwrapped.envs[0])


def test_our_pendulum_is_gymnasiums_at_all_boundaries() -> None:
    found = compare_contracts("IntegPendulum-v0", f"{__name__}:Told")
    assert all(check.compared for check in found.checks)
    assert not found.broken


@pytest.mark.parametrize(
    ("first", "second", "said"),
    [
        (HOPPER, "Walker2d-v5", "no action is the same"),
        ("InvertedPendulum-v5", "IntegCartPoleSwingUp-v0", None),
        ("IntegPendulum-v0", "Pendulum-v1", "cannot be put into a state"),
        ("dt=0.1", HOPPER, "is no environment"),
    ],
)
def test_what_does_not_correspond_is_refused(first: str, second: str, said: str | None) -> None:
    if said is None:  # states of two libraries correspond by their order
        assert compare_contracts(first, second).checks[0].compared
        return
    with pytest.raises(integ_gym.IntegGymError, match=said):
        compare_contracts(first, second)


@pytest.mark.parametrize(
    ("broken", "said"),
    [
        (["force", "acceleration", "constraint", "step"], ["force", "acceleration"]),
        (["constraint", "step"], ["constraint force"]),
        (["step"], ["change of velocity in a step"]),
    ],
)
def test_what_follows_from_another_difference_is_not_said_again(broken, said) -> None:
    checks = tuple(BoundaryCheck(boundary=name, sizes=(1, 2), tolerance=1e-6) for name in broken)
    found = Contract(first="a", second="b", states=1, starts_alone=False, checks=checks)
    words = contract_words(found, "in A", "in B")
    assert [*words] == [f"{name} has 1 components in A and 2 in B" for name in said]


class Floating(NativeEngine):
    """An engine of one's own whose gravity is a hundredth less."""

    def acceleration(self, q, v, force):
        found, still = super().acceleration(q, v, force), (0.0,) * len(v)
        weight = super().acceleration(q, still, still)
        return tuple(a - 0.01 * w for a, w in zip(found, weight, strict=True))


def test_an_engine_of_ones_own_is_held_against_ours() -> None:
    cell = f"engine={__name__}:Floating,integrator=rk4,dt=0.05"
    (check,) = compare_contracts("dt=0.05", cell, "IntegPendulum-v0").broken
    assert check.boundary == "acceleration"


@pytest.mark.parametrize(("kept", "verdict"), [(None, "fails"), (True, "fails"), (False, None)])
def test_a_transfer_to_a_cell_with_a_fault_is_not_tested(kept, verdict) -> None:
    rates = Rates(np.ones(8), np.zeros(8), np.zeros(8), None, np.ones(8))
    achieved = Achieved("achievable", Attempt("others", 1.0, 1.0))
    (judged,) = judge_family([Comparison("home", "there", rates, achieved, kept)])
    assert judged.verdict == (verdict or "contract_error")
    assert (judged.p_exceeds is None) == (verdict is None)


@pytest.fixture(scope="module", params=[kind.__name__ for kind in FAULTS])
def judged(request, tmp_path_factory):
    """A policy of Gymnasium's Hopper, judged on one with a fault; and the fault's boundary."""
    out = tmp_path_factory.mktemp("hoppers") / "out"
    panel = integ_gym.evaluate(
        "faulty_hoppers:stand", "faulty_hoppers:TwoHoppers", out, dts=[0.002], episodes=2,
        home="engine=mujoco,integrator=Euler,dt=0.002,control_period=0.008",
        environment={"success_return": 1000.0, "fault": request.param}, limit=False, workers=1,
        progress=False,
    )  # fmt: skip
    (boundary,) = (told[0] for kind, told in FAULTS.items() if kind.__name__ == request.param)
    return panel, out, boundary


@pytest.mark.slow
def test_a_cell_with_a_fault_gets_no_verdict_about_the_discretization(judged) -> None:
    panel, out, boundary = judged
    home, cell = sorted(panel.cells, key=lambda one: one.engine != "mujoco")
    (contract,) = panel.contracts
    assert (contract.first, contract.second) == (home.name, cell.name)
    assert panel.broken_contract("stand", cell.name) == contract
    assert [check.boundary for check in contract.broken] == [boundary]
    entry = panel.entry("stand", cell.name)
    assert entry.labels == {"contract_error": 2}
    assert entry.home_drop is entry.overfitting is None
    assert not panel.paired
    assert "contract_error" not in panel.entry("stand", home.name).labels
    assert all("contract_error" not in e.labels for e in panel.matrix if e.row != "stand")
    assert "nothing is said about dt" in panel.headline
    assert f"contract differs: {boundary} of" in panel.answer
    assert "contract differs" in (out / "report.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_a_comparison_is_made_again_when_a_run_is_verified(judged, tmp_path, capsys) -> None:
    _, out, _ = judged
    run = shutil.copytree(out, tmp_path / "run")
    verify = ["evidence", "verify", str(run), "--no-progress", "--own-code", "--depth", "whole"]
    main(verify)
    assert "contract" not in capsys.readouterr().out
    (marker, *_) = (run / "units").glob("contract-*.json")
    told = json.loads(marker.read_text(encoding="utf-8"))
    for check in told["contract"]["checks"]:
        check["differing"] = []
    marker.write_text(json.dumps(told), encoding="utf-8")
    assert main(verify) == 1
    assert marker.name in capsys.readouterr().out


FAULTY_PANEL = """
name = "two hoppers"
env_id = "faulty_hoppers:TwoHoppers"
control_period = 0.008
seeds = [0, 1]
episodes = 2
trainer = "sb3"
limit = false
family = [["mujoco Euler dt=0.002", "gymnasium Euler dt=0.002"]]

[environment]
success_return = 1.0
max_episode_steps = 20

[training]
total_steps = 64
n_envs = 2
n_steps = 32
batch_size = 64

[[train]]
engine = "mujoco"
integrator = "Euler"
dt = 0.002

[[evaluate]]
engine = "mujoco"
integrator = "Euler"
dt = 0.002

[[evaluate]]
engine = "gymnasium"
integrator = "Euler"
dt = 0.002
"""


@pytest.mark.slow
def test_a_panel_compares_engines_before_it_judges_what_it_trained(tmp_path) -> None:
    (tmp_path / "faulty.toml").write_text(FAULTY_PANEL, encoding="utf-8")
    panel = integ_gym.run_panel(tmp_path / "faulty.toml", tmp_path / "out", workers=1,
                                progress=False)  # fmt: skip
    (contract,) = panel.contracts
    assert [check.boundary for check in contract.broken] == ["force"]
    (judged,) = panel.verdicts
    assert (judged.verdict, judged.p_exceeds) == ("contract_error", None)
    entry = panel.entry(judged.row, judged.cell)
    assert entry.home_drop is entry.overfitting is entry.reference_class is None
    assert panel.headline.startswith("Not answered: every declared cell differs from home")
    assert "force of leg_joint" in panel.answer


def test_the_command_fails_where_something_differs(capsys) -> None:
    cells = ["--env", "IntegPendulum-v0", "gravity=9.81", "gravity=9.80665"]
    assert main(["contract", *cells, "--json"]) == 3
    told = json.loads(capsys.readouterr().out)
    broken = [check for check in told["checks"] if check["differing"]]
    assert [check["boundary"] for check in broken] == ["acceleration"]
    assert broken[0]["largest"] > TOLERANCE[64]
    assert main(["contract", *cells]) == 3
    assert "acceleration of theta" in " ".join(capsys.readouterr().out.split())
    assert main(["contract", "--env", "IntegPendulum-v0", "dt=0.05", "dt=0.01"]) == 0
