"""Why a published robot falls under some settings: its joint damping, and one solver iteration.

    python benchmarks/robot_causes.py go1:Go1 DIR [--episodes 4]

The first line is the largest h d / M, an eigenvalue of h M⁻¹D at the start: explicit Euler diverges
above 2. The others are how many episodes end in a fall and how long each lasts, s, by integrator,
solver iterations and warm start. The last two make the step of implicit damping here, from the sum
of the forces (M + h D)⁻¹ f as MuJoCo does, and from the solver's acceleration (M + h D)⁻¹ M a as
MuJoCo Warp does. Of a solver that has converged the two are one, since then M a = f.
"""

from functools import partial

import mujoco
import numpy as np
from robots import decisions, open_robot, robot_parser

from integ_gym import Discretization

NO_WARM_START = "no warm start"
FROM_FORCES, FROM_ACCELERATION = "stepped here from forces", "stepped here from the acceleration"
SETTINGS = (
    ("Euler", {"iterations": 1}, ""),
    ("Euler", {"iterations": 1, "eulerdamp": True}, ""),
    ("implicitfast", {"iterations": 1}, ""),
    ("implicitfast", {"iterations": 1}, NO_WARM_START),
    ("implicitfast", {"iterations": 3}, ""),
    ("implicitfast", {"iterations": 100, "ls_iterations": 50}, ""),
    ("implicitfast", {"iterations": 1}, FROM_FORCES),
    ("implicitfast", {"iterations": 1}, FROM_ACCELERATION),
)


def mass_and_damping(model, data, within_limits=False):
    """M, and D of joints and servos; MuJoCo leaves out those whose joints are at force limits."""
    mass = np.zeros((model.nv, model.nv))
    for column, unit in zip(mass, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, column, unit)
    damping = np.array(model.dof_damping).reshape(model.nv, -1)[:, 0].copy()
    for actuator in range(model.nu):
        joint = model.actuator_trnid[actuator, 0]
        dof = model.jnt_dofadr[joint]
        low, high = model.jnt_actfrcrange[joint]
        limited = within_limits and model.jnt_actfrclimited[joint]
        if not limited or low < data.qfrc_actuator[dof] < high:
            damping[dof] -= model.actuator_biasprm[actuator, 2]
    return mass, np.diag(damping)


def damping_number(model, data):
    """Largest eigenvalue of h M⁻¹D."""
    mass, damping = mass_and_damping(model, data)
    rates = np.linalg.eigvals(np.linalg.solve(mass, damping))
    return model.opt.timestep * float(np.max(rates.real))


def step_damped(model, data, integrated):
    """One step of semi-implicit Euler with implicit damping, in place of `mj_step`."""
    mujoco.mj_forward(model, data)
    mass, damping = mass_and_damping(model, data, within_limits=True)
    step = model.opt.timestep
    force = data.qfrc_smooth + data.qfrc_constraint
    if integrated == FROM_ACCELERATION:
        force = mass @ data.qacc
    data.qacc_warmstart[:] = data.qacc
    data.qvel[:] += step * np.linalg.solve(mass + step * damping, force)
    mujoco.mj_integratePos(model, data.qpos, data.qvel, step)
    data.time += step


def main():
    """Print what a robot's file and policy give."""
    given = robot_parser(__doc__, 4).parse_args()
    testbed, session = open_robot(given)
    home = testbed.home
    (env,) = testbed.make(home, 1).envs
    env.reset(seed=0)
    number = damping_number(env.unwrapped.model, env.unwrapped.data)
    print(f"{given.robot}: {home.integrator}, {home.dt:g} s; h d / M up to {number:.2f}")
    for integrator, solver, variant in SETTINGS:
        place = Discretization(integrator, home.dt, home.control_period, home.engine)
        (env,) = testbed.make(place, 1, solver=solver).envs
        if variant == NO_WARM_START:
            flags = mujoco.mjtDisableBit.mjDSBL_WARMSTART
            env.unwrapped.model.opt.disableflags |= int(flags)
        elif variant:
            env._ledger.take_step_by(partial(step_damped, integrated=variant))
        times = []
        for seed in range(given.episodes):
            *_, last = decisions(env, session, env.reset(seed=seed)[0])
            times.append(last["time"])
        fall = sum(time < testbed.duration - 0.5 * home.control_period for time in times)
        setting = [integrator, *(f"{name} {value}" for name, value in solver.items()), variant]
        print(
            f"{', '.join(filter(None, setting))}: {fall} of {len(times)} fall, "
            f"{' '.join(f'{time:.2f}' for time in times)} s",
            flush=True,
        )


if __name__ == "__main__":
    main()
