"""Why a published robot falls under some settings: its joint damping, and one solver iteration.

    python benchmarks/robot_causes.py go1:Go1 DIR [--episodes 4]

The first line is the largest h d / M, an eigenvalue of h M⁻¹D at the start: explicit Euler diverges
above 2. The others are how long episodes last, s, by integrator, solver iterations and warm start.
"""

import mujoco
import numpy as np
from robots import decisions, open_robot, robot_parser

from integ_gym import Discretization

SETTINGS = (
    ("Euler", {"iterations": 1}, True),
    ("Euler", {"iterations": 1, "eulerdamp": True}, True),
    ("implicitfast", {"iterations": 1}, True),
    ("implicitfast", {"iterations": 1}, False),
    ("implicitfast", {"iterations": 3}, True),
    ("implicitfast", {"iterations": 100, "ls_iterations": 50}, True),
)


def damping_number(model, data):
    """Largest eigenvalue of h M⁻¹D, of joint damping and of servos' damping."""
    mass = np.zeros((model.nv, model.nv))
    for column, unit in zip(mass, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, column, unit)
    damping = np.array(model.dof_damping).reshape(model.nv, -1)[:, 0].copy()
    for actuator in range(model.nu):
        joint = model.actuator_trnid[actuator, 0]
        damping[model.jnt_dofadr[joint]] -= model.actuator_biasprm[actuator, 2]
    rates = np.linalg.eigvals(np.linalg.solve(mass, np.diag(damping)))
    return model.opt.timestep * float(np.max(rates.real))


def main():
    """Print what a robot's file and policy give."""
    given = robot_parser(__doc__, 4).parse_args()
    testbed, session = open_robot(given)
    home = testbed.home
    (env,) = testbed.make(home, 1).envs
    env.reset(seed=0)
    number = damping_number(env.unwrapped.model, env.unwrapped.data)
    print(f"{given.robot}: {home.integrator}, {home.dt:g} s; h d / M up to {number:.2f}")
    for integrator, solver, warm in SETTINGS:
        place = Discretization(integrator, home.dt, home.control_period, home.engine)
        (env,) = testbed.make(place, 1, solver=solver).envs
        if not warm:
            flags = mujoco.mjtDisableBit.mjDSBL_WARMSTART
            env.unwrapped.model.opt.disableflags |= int(flags)
        times = []
        for seed in range(given.episodes):
            *_, last = decisions(env, session, env.reset(seed=seed)[0])
            times.append(last["time"])
        settings_text = ", ".join(f"{name} {value}" for name, value in solver.items())
        start = "" if warm else ", no warm start"
        print(
            f"{integrator}, {settings_text}{start}: {' '.join(f'{time:.2f}' for time in times)} s"
        )


if __name__ == "__main__":
    main()
