"""Robots on MJX, MuJoCo Warp and Newton: the model that they step is C MuJoCo's, or is refused."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from engine_cases import needs
from swaying import MONOPED, record_swaying

import integ_gym
from integ_gym import IntegGymError
from integ_gym.envs.rediscretized import integrator_of
from integ_gym.envs.registries import ENGINES
from integ_gym.envs.testbeds.making import find_testbed, make_checked
from integ_gym.envs.testbeds.mjcf_engines import (
    CONVERGED,
    MODEL_ENGINES,
    READ,
    MujocoModel,
    engine_of_model,
    integrators_of_model,
)
from integ_gym.envs.testbeds.mjcf_model import compile_model
from integ_gym.eval.contract import BoundaryName
from integ_gym.evidence.replaying import replay

ROUNDING = {64: 1e-10, 32: 1e-4}
"""Of one step's change of velocity, by width of floats: with a solver that has converged, what is
left is their rounding, times the stiffness of contacts in float32."""


pytestmark = pytest.mark.usefixtures("robots_found")


def on(engine, integrator="Euler"):
    """The monoped's home on an engine, whose integrator is called by MuJoCo's name."""
    needs(engine)
    testbed = find_testbed(MONOPED, {})
    own = {theirs: name for name, theirs in integrators_of_model(engine).items()}
    return testbed, replace(testbed.home, engine=engine, integrator=own[integrator])


@pytest.mark.slow
@pytest.mark.parametrize("engine", MODEL_ENGINES)
def test_one_step_is_c_mujocos_in_the_air_and_on_the_ground(engine):
    import mujoco

    testbed, place = on(engine)
    model, width = copy.copy(testbed.compiled.model), ENGINES.load(engine).width
    for name, value in CONVERGED.items():
        setattr(model.opt, name, value)
    steps, data = engine_of_model(engine, model, testbed.compiled), mujoco.MjData(model)
    touched = set()
    for height in (-0.02, 0.1):
        mujoco.mj_resetDataKeyframe(model, data, 0)
        data.qpos[1] += height
        data.qvel[:], data.ctrl[:] = 0.3, data.ctrl + 0.1
        then = mujoco.MjData(model)
        mujoco.mj_copyData(then, model, data)
        steps.advance(model, data)
        mujoco.mj_step(model, then)
        touched.add(data.ncon > 0)
        change = np.abs(then.qvel - 0.3).max()
        assert np.abs(data.qvel - then.qvel).max() < ROUNDING[width] * change
        assert np.abs(data.qpos - then.qpos).max() < ROUNDING[width]
        for name in ("qfrc_actuator", "qfrc_constraint"):
            own, expected = getattr(data, name), getattr(then, name)
            scale = np.abs([expected, then.qfrc_bias]).max()  # the weight is rounded, too
            assert np.abs(own - expected).max() <= ROUNDING[width] * scale, name
        assert data.time == then.time
    assert touched == {True, False}
    assert engine_of_model(engine, model, testbed.compiled) is steps
    found = integ_gym.compare_contracts(testbed.home, place, MONOPED, states=4)
    assert not found.broken
    assert all(check.compared for check in found.checks)
    assert [check.boundary for check in found.checks] == [*get_args(BoundaryName)]


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["mujoco", *MODEL_ENGINES])
def test_implicit_damping_of_a_solver_that_stops_early_is_of_what_the_engine_integrates(engine):
    """Forces f in MuJoCo and MJX, M a in MuJoCo Warp and Newton; they differ before it converges.

    docs/explanation/robots.md rests on it.
    """
    import mujoco

    testbed, _ = on(engine, "implicitfast")
    model = copy.copy(testbed.compiled.model)
    model.opt.integrator, model.opt.iterations = mujoco.mjtIntegrator.mjINT_IMPLICITFAST, 1
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qpos[1] -= 0.02
    data.qvel[:] = 0.3
    mujoco.mj_forward(model, data)
    assert data.ncon
    assert (model.actuator_biasprm[:, 2] == 0.0).all()
    mass = np.zeros((model.nv, model.nv))
    for row, unit in zip(mass, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, row, unit)
    damping = np.diag(model.dof_damping.reshape(model.nv, -1)[:, 0])
    given = {name: np.array(getattr(data, name)) for name in READ} | {"qacc_warmstart": np.zeros(6)}
    found, _ = engine_of_model(engine, model, testbed.compiled).step(given)
    step, change = model.opt.timestep, np.asarray(found["qvel"]) - data.qvel
    integrated = {
        "forces": data.qfrc_smooth + found["qfrc_constraint"],
        "acceleration": mass @ found["qacc"],
    }
    expected = {
        name: step * np.linalg.solve(mass + step * damping, force)
        for name, force in integrated.items()
    }
    own = "acceleration" if engine in ("mujoco_warp", "newton") else "forces"
    width = ENGINES.load(engine).width
    size = np.abs(change).max()
    assert np.abs(change - expected.pop(own)).max() < ROUNDING[width] * size
    ((_, other),) = expected.items()
    assert np.abs(change - other).max() > 0.01 * size


@pytest.mark.parametrize(
    ("field", "boundary"),
    [("qacc", "acceleration"), ("qfrc_constraint", "constraint"), ("qvel", "step")],
)
@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
def test_what_an_engine_steps_otherwise_is_found_where_it_is(
    monkeypatch, field, boundary, integrator
):
    """Accelerations and constraints are those of Euler, the step is the engine's own."""
    own = integrator if boundary == "step" else "Euler"

    class Off(MujocoModel):
        """C MuJoCo, but for a thousandth more of a quantity under one integrator."""

        def step(self, given):
            found, iterations = super().step(given)
            if integrator_of(self._model) == own:
                before = given["qvel"] if field == "qvel" else 0.0
                found = {**found, field: before + 1.001 * (found[field] - before)}
            return found, iterations

    def compare(kind):
        monkeypatch.setitem(MODEL_ENGINES, "mujoco_warp", kind)
        monkeypatch.setattr("integ_gym.envs.testbeds.mjcf_engines._MADE", {})
        return integ_gym.compare_contracts(testbed.home, place, MONOPED)

    testbed, place = on("mujoco_warp", integrator)
    place = replace(place, dt=0.5 * place.dt)
    (check,) = compare(Off).broken
    assert check.boundary == boundary
    assert "root_z" in {one.component for one in check.differing}
    assert all(abs(one.relative - 0.001) < 1e-5 for one in check.differing)
    assert not compare(MujocoModel).broken


def test_of_one_engine_no_step_is_compared():
    """Both would make it by the same program."""
    found = integ_gym.compare_contracts("integrator=Euler", "integrator=RK4", MONOPED)
    assert [check.boundary for check in found.checks] == [*get_args(BoundaryName)][:4]
    assert not found.broken


@pytest.mark.slow
@pytest.mark.parametrize("engine", MODEL_ENGINES)
def test_a_record_names_its_engine_and_is_played_again(engine, tmp_path):
    _, place = on(engine)
    testbed = find_testbed(MONOPED, {"duration": 0.24})
    made = make_checked(testbed, place, 1)
    file, record = record_swaying(made, tmp_path, 12)
    told = [record.fields[name] for name in ("engine", "integrator", "engine_version")]
    assert told == [engine, place.integrator, made.setups[0].engine.version]
    status = "not_reported" if engine == "mjx" else "not_converged"  # its file's one iteration
    assert record.fields["solver_status"] == status
    done = replay([(file, record)], exact=True, own_code=True).settle()
    assert (done.findings, done.skipped, done.exact) == ([], {}, 1)


@pytest.mark.parametrize(
    ("engine", "solver", "words"),
    [
        ("mjx", {"noslip_iterations": 3}, "noslip_iterations"),
        ("mjx", {"solver": "PGS"}, "PGS"),
        ("mujoco_warp", {"solver": "PGS"}, "PGS"),
        ("newton", {"eulerdamp": True}, "eulerdamp"),
    ],
)
def test_what_an_engine_does_not_take_is_refused_by_name(engine, solver, words):
    testbed, place = on(engine)
    with pytest.raises(IntegGymError, match=words):
        make_checked(testbed, place, 1, solver=solver)


def test_integrators_and_engines_that_are_not_there_are_refused_by_name():
    testbed, place = on("mjx")
    with pytest.raises(IntegGymError, match="implicitfast"):
        make_checked(testbed, replace(place, integrator="implicit"), 1)
    with pytest.raises(IntegGymError, match="mujoco_warp"):
        make_checked(testbed, replace(place, engine="drake"), 1)
    assert "featherstone" not in testbed.integrators("newton")


def test_newton_takes_a_mesh_that_collides_from_beside_the_models_file(tmp_path):
    needs("newton")
    import mujoco

    (folder := tmp_path / "robot" / "meshes").mkdir(parents=True)
    corners = "v 0 0 0\nv 0 0 .4\nv 0 .2 0\nv .3 0 0\n"
    (folder / "part.obj").write_text(f"{corners}f 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\n")
    (tmp_path / "robot" / "robot.xml").write_text(
        '<mujoco><compiler meshdir="meshes"/><asset><mesh name="part" file="part.obj"/></asset>'
        '<worldbody><geom type="plane" size="5 5 1"/><body name="torso"><freejoint/>'
        '<inertial pos="0 0 0" mass="1" diaginertia=".2 .2 .3"/><geom type="mesh" mesh="part"/>'
        "</body></worldbody></mujoco>"
    )
    compiled = compile_model(tmp_path / "robot" / "robot.xml")
    engine = engine_of_model("newton", compiled.model, compiled)
    one, other = (mujoco.MjData(compiled.model) for _ in range(2))
    for data in (one, other):
        data.qpos[2] = -0.001
    engine.advance(compiled.model, one)
    mujoco.mj_step(compiled.model, other)
    assert other.ncon == 3
    np.testing.assert_allclose(one.qvel, other.qvel, rtol=1e-4, atol=1e-6)
