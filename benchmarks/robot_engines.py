"""One step of a published robot's model in the engines of MuJoCo's family, beside C MuJoCo's.

``python benchmarks/robot_engines.py go1:Go1 DIR``: the same states and controls, Euler at the
file's timestep, a solver that converges. Printed are the largest differences from C MuJoCo in any
of these states, over the largest size: of the accelerations, of the generalized forces of contacts
and other constraints, and of the velocities after the step.
"""

import copy

import mujoco
import numpy as np
from robots import decisions, open_robot, robot_parser

from integ_gym.envs.testbeds.mjcf_engines import (
    CONVERGED,
    MODEL_ENGINES,
    READ,
    WRITTEN,
    engine_of_model,
)

COMPARED = {"acceleration": "qacc", "contact force": "qfrc_constraint", "velocity": "qvel"}


def inputs_of_steps(testbed, session, episodes):
    """What a step is given at starts, and 0.5 s later in every second episode."""
    (env,) = testbed.make(testbed.home, 1).envs
    for seed in range(episodes):
        observation, _ = env.reset(seed=seed)
        if seed % 2:
            later = (info for info in decisions(env, session, observation) if info["time"] > 0.5)
            next(later, None)  # a fall comes before
        given = {name: np.array(getattr(env.unwrapped.data, name)) for name in READ}
        yield given | {"qacc_warmstart": np.zeros(env.unwrapped.model.nv)}


def main():
    given = robot_parser(__doc__, 32).parse_args()
    testbed, session = open_robot(given)
    inputs = list(inputs_of_steps(testbed, session, given.episodes))
    model = copy.copy(testbed.compiled.model)
    for name, value in {**CONVERGED, "integrator": mujoco.mjtIntegrator.mjINT_EULER}.items():
        setattr(model.opt, name, value)
    data, expected = mujoco.MjData(model), []
    for fields in inputs:
        for name, value in fields.items():
            getattr(data, name)[:] = value
        mujoco.mj_step(model, data)
        expected.append({name: np.array(getattr(data, name)) for name in WRITTEN})
    for engine in MODEL_ENGINES:
        steps = engine_of_model(engine, model, testbed.compiled)
        found = [copy.deepcopy(steps.step(fields)[0]) for fields in inputs]
        apart = []
        for words, name in COMPARED.items():
            ours, theirs = (np.array([one[name] for one in each]) for each in (expected, found))
            apart.append(f"{words} {np.abs(theirs - ours).max() / np.abs(ours).max():.1g}")
        print(f"{given.robot} on {steps.title}: {', '.join(apart)}", flush=True)


if __name__ == "__main__":
    main()
