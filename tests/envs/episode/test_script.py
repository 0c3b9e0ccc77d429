"""Steps written in JavaScript do in a browser what they do in Python."""

import json
import math
from collections.abc import Iterator
from functools import partial

import numpy as np
import pytest
from driving import Browser, driven
from pairing import pairs
from variants import VARIANTS

from integ_gym.envs.environment import environment_setup
from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.registries import ENVIRONMENTS, INTEGRATORS
from integ_gym.envs.steps import script_of
from integ_gym.envs.transition import EnvState, control_columns, initial_state, scalar_step

SECONDS = 10.0
SMALL = 1e-5
WRITTEN = sorted({*VARIANTS} - {"lossy"})
"""Variants without chance, which a browser has no numbers for."""
PLAYED = """((start, step) => {
  let [state, observation] = start(...%s);
  const told = [];
  for (const action of %s) {
    const after = step(state, action);
    if (after === null) return [...told, null];
    [state, observation] = after;
    const { controls, motor, numerics, losses, ended, success } = after[2];
    told.push([...state[0], ...state[1], ...observation, ...controls, motor, numerics, losses, +ended, +success]);
  }
  return told;
})(%s,
%s)"""  # noqa: E501


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with driven(tmp_path_factory.mktemp("browser")) as found:
        found.open("data:text/html,steps")
        yield found


def _played(setup, q, v, actions):
    state = initial_state(SCALAR, setup, q, v)
    step, told = partial(scalar_step, setup, SCALAR), []
    for action in actions:
        after, observation, _, terminated, truncated, info, _ = step(state, tuple(action))
        state = EnvState._make(after)
        losses = info["dissipated"] + info["contact_loss"] + info["clip_loss"]
        controls = [info[applied] for _, applied in control_columns(setup.plant)]
        ledger = (*controls, info["actuator_work"], info["energy_residual"], losses)
        if info["solver_status"] == 2:
            return [*told, None]
        ended = float(terminated or truncated)
        told.append([*state.q, *state.v, *observation, *ledger, ended, float(info["success"])])
    return told


@pytest.mark.slow
@pytest.mark.parametrize(("env_id", "variant"), pairs(ENVIRONMENTS, WRITTEN, strength=1))
def test_a_browser_gets_where_python_gets(env_id, variant, browser):
    for integrator in INTEGRATORS.names():
        setup = environment_setup(env_id, {"integrator": integrator, **VARIANTS[variant]})
        script = script_of(setup)
        assert script is not None
        rng = np.random.default_rng(3)
        count = len(setup.plant.coordinates)
        q, v = (tuple(rng.normal(0.0, 0.1, count).tolist()) for _ in range(2))
        steps = math.ceil(SECONDS / setup.timing.control_period)
        if setup.task.discrete is None:
            limits = 1.2 * np.array(setup.largest_controls)
            actions = rng.uniform(-limits, limits, (steps, len(limits))).tolist()
        else:
            actions = rng.integers(setup.task.discrete, size=(steps, 1)).astype(float).tolist()
        expected = _played(setup, q, v, actions)
        found = browser.value(PLAYED % (json.dumps([q, v]), json.dumps(actions), *script))
        assert (None in found, len(found)) == (None in expected, len(expected)), integrator
        here, there = (np.array([row for row in rows if row]) for rows in (found, expected))
        np.testing.assert_allclose(here, there, rtol=SMALL, atol=SMALL, err_msg=integrator)


GROUND = {
    "in the air": ((0.0, 0.62, 0.1, 0.2, 0.5), (1.0, -0.5, 0.3, -0.4, 0.0), False),
    "on the ground": ((0.3, 0.47, -0.05, 0.1, 0.48), (0.8, -0.6, 0.2, 1.0, -0.3), True),
}
"""(q, v), and whether the hopper's foot is pressed on the ground, and slides."""


@pytest.mark.slow
@pytest.mark.parametrize("place", GROUND)
def test_a_browser_meets_the_ground_as_python_does(place, browser):
    """One decision of 0.02 s, by the same contact law to 1e-9 of every number."""
    q, v, touches = GROUND[place]
    for integrator in INTEGRATORS.names():
        given = {"integrator": integrator, "dt": 0.002, "control_period": 0.02}
        setup = environment_setup("IntegHopper-v0", given)
        actions = [[3.0, -20.0]]
        start = initial_state(SCALAR, setup, q, v)
        *_, info, _ = scalar_step(setup, SCALAR, start, tuple(actions[0]))
        assert (info["foot_penetration"] > 0.0) == (info["slip_loss"] > 0.0) == touches
        expected = _played(setup, q, v, actions)
        found = browser.value(PLAYED % (json.dumps([q, v]), json.dumps(actions), *script_of(setup)))
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9, err_msg=integrator)


def test_what_is_not_finite_is_refused_and_noise_is_not_written():
    setup = environment_setup("IntegPendulum-v0", {"integrator": "rk4"})
    script = script_of(setup)
    assert "if (!(Number.isFinite(" in script.step
    assert script_of(environment_setup("IntegPendulum-v0", {"observation_noise": 0.01})) is None


def test_a_step_that_asks_for_a_value_is_not_written(tmp_path, monkeypatch):
    (tmp_path / "asking.py").write_text(
        "from integ_gym.envs.integrators.rk4 import RK4\n\n\n"
        "class Asking(RK4):\n"
        "    def step(self, ops, system, q, v, losses, control, dt):\n"
        "        h = dt if v[0] > 0.0 else 0.5 * dt\n"
        "        return super().step(ops, system, q, v, losses, control, h)\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    arguments = {"integrator": "asking:Asking"}
    assert script_of(environment_setup("IntegPendulum-v0", arguments)) is None
