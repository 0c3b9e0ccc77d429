"""Loops that a user of an engine alone would write: set the control, step, read the state back.

They have no reward, no `info` and no ledger. Each runs on the model of an engine of ours, so that
both move the same bodies.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from integ_gym.envs.ops.ops import Components
from integ_gym.envs.settings import Setup


class Bare(NamedTuple):
    """A bare loop over one engine."""

    start: Callable[[Components, Components], Any]
    """Sets configuration and velocities, off the clock."""
    drive: Callable[[Sequence[float]], Any]
    """One control period per control, as floats, N or N m; (q, v) after the last."""
    only_step: Callable[[int], Any]
    """So many control periods without setting or reading anything."""


def mujoco(setup: Setup) -> Bare:
    """`mj_step` with its own repetitions."""
    import mujoco as mj

    engine: Any = setup.engine
    model, place, count = engine._model, setup.plant.actuated[0], setup.timing.substeps
    data = mj.MjData(model)
    step = partial(mj.mj_step, model, data, **({} if count == 1 else {"nstep": count}))

    def start(q: Components, v: Components) -> None:
        mj.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = q, v

    def drive(controls: Sequence[float]) -> Any:
        for control in controls:
            data.qfrc_applied[place] = control
            step()
            q, v = data.qpos.copy(), data.qvel.copy()
        return q, v

    def only_step(periods: int) -> None:
        for _ in range(periods):
            step()

    return Bare(start, drive, only_step)


def drake(setup: Setup) -> Bare:
    """A `Simulator` that advances by the step, of a continuous or a discrete plant."""
    from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator

    from integ_gym.envs.engines.drake import ACCURACY, DISCRETE, IMPLICIT

    engine: Any = setup.engine
    plant, count, dt = engine._plant, setup.timing.substeps, setup.timing.dt
    simulator = Simulator(plant)
    if engine.integrator not in DISCRETE:
        integrator = ResetIntegratorFromFlags(simulator, engine.integrator, dt)
        integrator.set_fixed_step_mode(True)
        integrator.set_maximum_step_size(dt)
        if engine.integrator in IMPLICIT:
            integrator.set_target_accuracy(ACCURACY)
    context, port = (
        simulator.get_mutable_context(),
        plant.get_applied_generalized_force_input_port(),
    )
    force, done = np.zeros(plant.num_velocities()), 0

    def start(q: Components, v: Components) -> None:
        nonlocal done
        done = 0
        context.SetTime(0.0)
        plant.SetPositionsAndVelocities(context, (*q, *v))
        port.FixValue(context, force)
        simulator.Initialize()

    def drive(controls: Sequence[float]) -> Any:
        for control in controls:
            force[setup.plant.actuated[0]] = control
            port.FixValue(context, force)
            only_step(1)
            state = plant.GetPositionsAndVelocities(context)
        return np.split(state, 2)

    def by_difference(periods: int) -> None:
        for _ in range(periods * count):
            simulator.AdvanceTo(context.get_time() + dt)

    def by_number(periods: int) -> None:
        nonlocal done
        for _ in range(periods * count):
            done += 1
            simulator.AdvanceTo(done * dt)

    only_step = by_number if engine.integrator in DISCRETE else by_difference
    return Bare(start, drive, only_step)


def pinocchio(setup: Setup) -> Bare:
    """Symplectic Euler by hand over `aba`, as in Pinocchio's examples."""
    import pinocchio as pin

    engine: Any = setup.engine
    model, count, dt = engine._bodies._model, setup.timing.substeps, setup.timing.dt
    data, q, v, force = model.createData(), *np.zeros((3, model.nv))

    def start(begin_q: Components, begin_v: Components) -> None:
        q[:], v[:] = begin_q, begin_v

    def drive(controls: Sequence[float]) -> Any:
        for control in controls:
            force[setup.plant.actuated[0]] = control
            only_step(1)
        return q, v

    def only_step(periods: int) -> None:
        nonlocal q, v
        for _ in range(periods * count):
            v += dt * pin.aba(model, data, q, v, force)
            q += dt * v

    return Bare(start, drive, only_step)


def dart(setup: Setup) -> Bare:
    """`World.step`, which forgets forces unless asked to keep them."""
    engine: Any = setup.engine
    world, skeleton, count = engine._world, engine._skeleton, setup.timing.substeps
    force = np.zeros(skeleton.getNumDofs())

    def start(q: Components, v: Components) -> None:
        skeleton.setPositions(q)
        skeleton.setVelocities(v)

    def drive(controls: Sequence[float]) -> Any:
        for control in controls:
            force[setup.plant.actuated[0]] = control
            skeleton.setForces(force)
            only_step(1)
            q, v = skeleton.getPositions(), skeleton.getVelocities()
        return q, v

    def only_step(periods: int) -> None:
        for _ in range(periods * count):
            world.step(False)

    return Bare(start, drive, only_step)


def pybullet(setup: Setup) -> Bare:
    """`stepSimulation`, which forgets forces after each step."""
    engine: Any = setup.engine
    bullet, body, client = engine._bullet, engine._body, engine._client
    count, joints = setup.timing.substeps, range(len(setup.plant.coordinates))

    def start(q: Components, v: Components) -> None:
        for joint in joints:
            bullet.resetJointState(body, joint, q[joint], v[joint], client)

    def drive(controls: Sequence[float]) -> Any:
        for control in controls:
            for _ in range(count):
                bullet.setJointMotorControl2(
                    body, setup.plant.actuated[0], bullet.TORQUE_CONTROL, force=control,
                    physicsClientId=client,
                )  # fmt: skip
                bullet.stepSimulation(client)
            joint_states = bullet.getJointStates(body, joints, client)
            q, v = [state[0] for state in joint_states], [state[1] for state in joint_states]
        return q, v

    def only_step(periods: int) -> None:
        for _ in range(periods * count):
            bullet.stepSimulation(client)

    return Bare(start, drive, only_step)


def sapien(setup: Setup) -> Bare:
    """`PhysxCpuSystem.step`."""
    engine: Any = setup.engine
    (_, system, articulation), count = engine._world, setup.timing.substeps
    force = np.zeros(len(setup.plant.coordinates), np.float32)

    def start(q: Components, v: Components) -> None:
        articulation.set_qpos(q)
        articulation.set_qvel(v)

    def drive(controls: Sequence[float]) -> Any:
        for control in controls:
            force[setup.plant.actuated[0]] = control
            articulation.set_qf(force)
            only_step(1)
            q, v = articulation.get_qpos(), articulation.get_qvel()
        return q, v

    def only_step(periods: int) -> None:
        for _ in range(periods * count):
            system.step()

    return Bare(start, drive, only_step)


def casadi(setup: Setup) -> Bare:
    """CasADi's `rk` as a function that is called with arrays."""
    import casadi as ca

    from integ_gym.envs.engines.casadi_ops import CasadiOps, Expression, plain

    plant, n, count = setup.plant, len(setup.plant.coordinates), setup.timing.substeps
    x, u = ca.SX.sym("x", 2 * n), ca.SX.sym("u")
    q, v = (tuple([Expression(x[i]) for i in range(k, k + n)]) for k in (0, n))
    force = setup.system.to_generalized_force((Expression(u),))
    slopes = [plain(a) for a in (*v, *plant.acceleration(CasadiOps(), q, v, force))]
    dae = {"x": x, "p": u, "ode": ca.vertcat(*slopes)}
    options = {"number_of_finite_elements": 1}
    step = ca.integrator("step", "rk", dae, 0.0, setup.timing.dt, options)
    state = ca.DM.zeros(2 * n)

    def start(q: Components, v: Components) -> None:
        nonlocal state
        state = ca.DM([*q, *v])

    def drive(controls: Sequence[float]) -> Any:
        nonlocal state
        for control in controls:
            for _ in range(count):
                state = step(x0=state, p=control)["xf"]
            end = state.full().ravel()
        return end[:n], end[n:]

    def only_step(periods: int) -> None:
        for _ in range(periods * count):
            step(x0=state, p=0.0)

    return Bare(start, drive, only_step)


LOOPS: dict[str, Callable[[Setup], Bare]] = {
    "mujoco": mujoco,
    "drake": drake,
    "pinocchio": pinocchio,
    "dart": dart,
    "pybullet": pybullet,
    "sapien": sapien,
    "casadi": casadi,
}
"""By engine. `mjx`, `mujoco_warp` and `newton` are compiled for many worlds: no loop of theirs over
one world would be written."""
