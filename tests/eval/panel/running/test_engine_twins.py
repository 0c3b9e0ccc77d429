"""Which native cell an engine's cell is compared with, where stops or friction act."""

from __future__ import annotations

import numpy as np
import pytest
from engine_cases import needs, setup_of
from small_panel import bare_data

from integ_gym.envs.engines.rigid import HeldForce
from integ_gym.envs.ops.ops import SCALAR, along
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.envs.registries import INTEGRATORS
from integ_gym.envs.settings import Discretization
from integ_gym.eval.panel.cells import Cell
from integ_gym.eval.panel.findings import EVALUATED_ONCE, agreements, twin_of
from integ_gym.eval.panel.matrix import Matrix, PanelLayout
from integ_gym.eval.panel.result import Policy, Row
from integ_gym.eval.panel.spec import parse_spec

FREE = Pendulum()
NATIVE = {
    cell.name: cell
    for name in INTEGRATORS.names()
    for cell in [Cell.of(Discretization(name, 0.01, 0.05), "grid")]
}


def _twin(engine, integrator, resisted, plant=FREE):
    cell = Cell.of(Discretization(integrator, 0.01, 0.05, engine), "grid")
    found = twin_of(cell, NATIVE, plant, resisted)
    return None if found is None else NATIVE[found].discretization.integrator


@pytest.mark.parametrize(
    ("engine", "integrator", "free", "resisted"),
    [
        ("mujoco", "RK4", "rk4", None),
        ("mujoco", "Euler", "symplectic_euler", "symplectic_euler"),
        ("drake", "radau1", "implicit_euler", None),
        ("drake", "runge_kutta5", None, None),
        ("casadi", "rk", "rk4", "rk4"),
    ],
)
def test_a_cell_whose_stops_act_otherwise_has_no_twin(engine, integrator, free, resisted):
    assert _twin(engine, integrator, False) == free
    assert _twin(engine, integrator, True) == resisted


@pytest.mark.parametrize(
    ("engine", "integrator", "plant", "twin"),
    [
        ("mujoco", "Euler", CartPole(), "symplectic_euler"),
        ("mujoco", "Euler", Pendulum(damping=0.1), None),
        ("mujoco", "implicit", Pendulum(), "symplectic_euler"),
        ("mujoco", "implicit", CartPole(), None),
        ("pybullet", "semi_implicit_euler", Pendulum(damping=0.1), "symplectic_euler"),
        ("sapien", "tgs", CartPole(damping=0.01), None),
    ],
)
def test_forces_of_the_velocity_tell_maps_apart(engine, integrator, plant, twin):
    assert _twin(engine, integrator, False, plant) == twin


@pytest.mark.parametrize(
    ("env_id", "twin"),
    [("IntegCartPole-v0", "rk4 dt=0.05"), ("IntegCartPoleSwingUp-v0", None)],
)
def test_a_panel_looks_whether_its_plant_has_stops(env_id, twin):
    needs("mujoco")
    place = {"integrator": "rk4", "dt": 0.05}
    theirs = {"engine": "mujoco", "integrator": "RK4", "dt": 0.05}
    spec = parse_spec(bare_data(place, theirs, env_id=env_id, environment={}), "test")
    cells = {cell.name: cell for cell in spec.columns()}
    rows = (Row.of("zero", "baseline", [Policy(id="zero")]),)
    records = [
        {"policy_id": "zero", "cell": cell, "episode_index": k, "success": True}
        for cell in cells
        for k in range(2)
    ]
    layout = PanelLayout(rows, cells, {"zero": tuple(cells)}, None)
    (found,) = agreements(layout, Matrix(rows, records, 2), spec)
    assert found.twin == twin
    assert found.differing == (None if twin is None else 0)


@pytest.mark.parametrize("name", INTEGRATORS.names())
def test_a_force_held_is_the_force_itself_where_it_is_evaluated_once(name):
    setup = setup_of("native", name, "IntegCartPoleSwingUp-v0", dt=0.01)
    q, v = (2.43, 3.0), (0.5, 2.0)
    force = along(setup.system.generalized((1.0,)), 1.0, setup.system.resistance(SCALAR, q, v)[0])
    integrator, held = INTEGRATORS.load(name)(), HeldForce(setup.plant, force)
    mine = integrator.step(SCALAR, setup.system, q, v, (0.0, 0.0), (1.0,), 0.01)
    other = integrator.step(SCALAR, held, q, v, (0.0,), (1.0,), 0.01)
    same = np.allclose((*mine.q, *mine.v), (*other.q, *other.v), rtol=0, atol=1e-12)
    assert same == (name in EVALUATED_ONCE)
