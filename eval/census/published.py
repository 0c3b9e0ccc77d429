"""Libraries that publish a pendulum or a cart-pole, and how their motion is got at."""

from __future__ import annotations

import contextlib
import io
import math
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.ops.ops import SCALAR, Components, join_state, split_state
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.plants.interface import Plant
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.envs.testbeds.making import find_testbed, make_checked
from integ_gym.support.errors import InputError
from integ_gym.support.isolated import ISOLATED, IsolatedEnvironment
from integ_gym.support.optional import package_version

from .subjects import (
    Access,
    Episode,
    Observed,
    Policy,
    Settable,
    State,
    Statement,
    Subject,
    nearest_turn,
)


class Library(ABC):
    """A library that publishes a pendulum or a cart-pole."""

    title: ClassVar[str]
    """Its name, as people write it."""
    package: ClassVar[str]
    """The distribution whose version is reported."""
    modules: ClassVar[tuple[str, ...]]
    """What has to be importable."""
    apart: ClassVar[IsolatedEnvironment | None] = None
    """The environment of its own that it runs in, if it has one."""
    install: ClassVar[str]
    """The command that makes it so."""

    @abstractmethod
    def subjects(self) -> Iterator[Subject]:
        """Its environments."""

    def subject(
        self,
        name: str,
        plant: Plant,
        stated: Statement,
        max_control: float,
        access: Access,
        **more: Any,
    ) -> Subject:
        """One of its environments; see :class:`Subject`."""
        found = package_version(self.package) if self.apart is None else self.apart.version()
        version = found or "unknown"
        return Subject(self.title, name, version, True, plant, stated, max_control, access, **more)

    def pendulum(
        self, name: str, parameters: Any, max_control: float, step: numerics.OneStep, note: str = ""
    ) -> Subject:
        """A pendulum in float32 whose parameters have Gymnasium's names."""
        plant = Pendulum(mass=parameters.m, length=parameters.l, gravity=parameters.g)
        stated = Statement(parameters.dt, max_speed=parameters.max_speed)
        return self.subject(name, plant, stated, max_control, Settable(step), width=32, note=note)

    def cart_pole(
        self, name: str, parameters: Any, step: numerics.OneStep, words: str = "", **more: Any
    ) -> Subject:
        """A cart-pole whose parameters have Gymnasium's names; Euler's if it names any method."""
        plant = CartPole(
            cart_mass=parameters.masscart,
            mass=parameters.masspole,
            length=parameters.length,
            gravity=parameters.gravity,
        )
        stated = Statement(parameters.tau, map="explicit_euler" if words else None, words=words)
        return self.subject(name, plant, stated, parameters.force_mag, Settable(step), **more)


def jax_step(
    advance: Callable[[Any, Any, Any], tuple[Any, Any]], gear: float = 1.0
) -> numerics.OneStep:
    """One control period by a function of (q, v, action), in float32 as JAX has it by default.

    Args:
        advance: gets arrays of shape (coordinates,), (coordinates,) and (1,); it is compiled.
        gear: the control of an action of 1, N or N m.
    """
    compiled = import_module("jax").jit(advance)

    def advance_once(q: Components, v: Components, control: float) -> tuple[Components, Components]:
        end_q, end_v = compiled(*(np.array(x, dtype=np.float32) for x in (q, v, [control / gear])))
        q, v = (tuple(np.array(x, np.float64).ravel().tolist()) for x in (end_q, end_v))
        return q, v

    return advance_once


AGREEMENT = 1e-9
"""Largest relative error of the plant's mass matrix and gravity force."""

PROBES = ((0.3, -0.7), (-0.2, 2.2))
"""Configurations at which the plant is compared with the model."""

INTEGRATORS = {
    "mjINT_EULER": ("symplectic_euler_implicit_damping", "Euler"),
    "mjINT_RK4": ("rk4", "RK4"),
    "mjINT_IMPLICIT": ("symplectic_euler_implicit_velocity", "implicit"),
    "mjINT_IMPLICITFAST": ("symplectic_euler_implicit_damping", "implicitfast"),
}
"""MuJoCo's integrators: the map that its documentation describes, and its name there."""


def plant_of(model: Any) -> Plant:
    """The point mass on a rod, and on a cart, that moves as a model of one hinge does.

    Raises:
        ValueError: if the model moves otherwise.
    """
    n = int(model.nv)
    mass, _ = _dynamics(model, (0.0,) * n)
    _, weight = _dynamics(model, (*(0.0,) * (n - 1), 0.5 * math.pi))
    inertia, torque = float(mass[-1, -1]), float(weight[-1])
    damping = [float(x) for x in model.dof_damping]
    gravity = float(np.linalg.norm(model.opt.gravity))
    same: Any = {"gravity": gravity, "damping": damping[-1], "mass_distribution": "point"}
    made: Plant
    if n == 1:
        length = inertia * gravity / torque
        made = Pendulum(mass=torque**2 / (inertia * gravity**2), length=length, **same)
    else:
        moment = float(mass[0, 1])
        made = CartPole(
            cart_mass=float(mass[0, 0]) - moment**2 / inertia,
            mass=moment**2 / inertia,
            length=inertia / moment,
            cart_damping=damping[0],
            **same,
        )
    for probe in PROBES:
        q = probe[-n:]
        mass, weight = _dynamics(model, q)
        expected: np.ndarray = np.array(made.mass_matrix(SCALAR, q))
        still = (0.0,) * n
        pull = expected @ np.array(made.acceleration(SCALAR, q, still, still))
        for got, wanted in ((mass, expected), (weight, pull)):
            if not np.allclose(got, wanted, rtol=AGREEMENT, atol=AGREEMENT):
                raise InputError(
                    f"the MuJoCo model does not move as a {made.name} at q = {q}: "
                    f"{got.tolist()} for {wanted.tolist()}"
                )
    return made


def statement_of(model: Any, substeps: int = 1) -> Statement:
    """What a model says of its discretization."""
    mujoco = import_module("mujoco")
    integrator = mujoco.mjtIntegrator(model.opt.integrator).name
    known, words = INTEGRATORS.get(integrator, (None, integrator))
    undamped = bool(model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    if integrator == "mjINT_EULER" and undamped:
        known, words = "symplectic_euler", "Euler, eulerdamp off"
    return Statement(substeps * model.opt.timestep, substeps, known, words)


def control_step(model: Any) -> numerics.OneStep:
    """One ``mj_step``; the control is a force or torque at the joint."""
    mujoco = import_module("mujoco")
    data, n = mujoco.MjData(model), int(model.nv)
    gear = float(model.actuator_gear[0, 0])

    def advance_once(q: Components, v: Components, control: float) -> tuple[Components, Components]:
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:], data.ctrl[0] = q, v, control / gear
        mujoco.mj_step(model, data)
        end = (*data.qpos.tolist(), *data.qvel.tolist())
        return end[:n], end[n:]

    return advance_once


def max_control(model: Any) -> float:
    """Largest force or torque of the motor, N or N m."""
    return float(model.actuator_gear[0, 0] * model.actuator_ctrlrange[0, 1])


def _dynamics(model: Any, q: Components) -> tuple[np.ndarray, np.ndarray]:
    """Mass matrix and gravity force at rest."""
    mujoco = import_module("mujoco")
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    return mass, -np.array(data.qfrc_bias)


class DmControl(Library):
    """The suite's models, compiled and stepped by the installed MuJoCo.

    The environments themselves are not made: dm_control 1.0.50 does not load its `Physics` with
    MuJoCo 4.0. What one control period does is in the model: the suite's environments leave it at
    one physics step.
    """

    title = "dm_control"
    package = "dm_control"
    modules = ("dm_control", "mujoco")
    install = "pip install dm_control"

    def subjects(self) -> Iterator[Subject]:
        """Domains `pendulum` and `cartpole`."""
        mujoco = import_module("mujoco")
        for domain in ("pendulum", "cartpole"):
            suite = import_module(f"dm_control.suite.{domain}")
            model = mujoco.MjModel.from_xml_string(*suite.get_model_and_assets())
            yield self.subject(
                domain, plant_of(model), statement_of(model), max_control(model),
                Settable(control_step(model)),
                note=f"the suite's model, stepped by mujoco {mujoco.__version__} itself",
            )  # fmt: skip


ENVIRONMENTS = 32
"""Episodes watched at once."""

STEPS: dict[Policy, int] = {"random": 50, "driven": 200, "zero": 1000}
"""Control periods that they are watched for at most."""

NAMESAKE = "episodes watched; parameters and step are Gymnasium's, which it ports"
COPY = "episodes watched; parameters and step are those of its copy of dm_control's model"


class EnvPool(Library):
    """Watches episodes: EnvPool sets no state."""

    title = "EnvPool"
    package = "envpool"
    modules = ("envpool", "mujoco")
    install = "pip install envpool mujoco"

    def subjects(self) -> Iterator[Subject]:
        """Ports of Gymnasium's classic control and of dm_control's suite."""
        ported: dict[str, Any] = {"width": 32, "note": NAMESAKE}
        watched = Observed(Watch("Pendulum-v1", _gymnasium_pendulum, 2.0))
        stated = Statement(0.05, max_speed=8.0)
        yield self.subject("Pendulum-v1", Pendulum(), stated, 2.0, watched, **ported)
        for name in ("CartPole-v1", "phys2d/CartPole-v1"):
            watched = Observed(Watch(name, _gymnasium_cart_pole, 10.0), has_zero=False)
            yield self.subject(name, CartPole(), Statement(0.02), 10.0, watched, **ported)
        for name, file, decode in (
            ("PendulumSwingup-v1", "pendulum.xml", _suite_pendulum),
            ("CartpoleBalance-v1", "cartpole.xml", _suite_cart_pole),
        ):
            assets = Path(import_module("envpool_assets").__path__[0], "mujoco", "assets_dmc")
            model = import_module("mujoco").MjModel.from_xml_path(str(assets / file))
            strongest, plant = max_control(model), plant_of(model)
            watched = Observed(Watch(name, decode, strongest))
            yield self.subject(name, plant, statement_of(model), strongest, watched, note=COPY)


@dataclass(frozen=True)
class Watch:
    """Episodes of one environment.

    Attributes:
        name: of the environment.
        decode: observations of a batch to states.
        strongest: the control of the largest action.
    """

    name: str
    decode: Callable[[Any], list[State]]
    strongest: float

    def __call__(self, policy: Policy) -> list[Episode]:
        """Until they end, or for :data:`STEPS`."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of bounds beyond float32
            env = import_module("envpool").make_gymnasium(self.name, num_envs=ENVIRONMENTS, seed=7)
            episodes = [Episode([state], []) for state in self.decode(env.reset()[0])]
            running, rng = np.full(ENVIRONMENTS, True), np.random.default_rng(7)
            for _ in range(STEPS[policy]):
                actions, controls = self._choose(policy, env.action_space, episodes, rng)
                observations, _, ended, cut, _ = env.step(actions)
                states = self.decode(observations)
                for k in np.flatnonzero(running):
                    (*places, angle), v = states[k]
                    angle = nearest_turn(angle, episodes[k].states[-1][0][-1])
                    episodes[k].controls.append(float(controls[k]))
                    episodes[k].states.append(((*places, angle), v))
                running &= ~(ended | cut)
                if not running.any():
                    break
            env.close()
        return episodes

    def _choose(
        self, policy: Policy, space: Any, episodes: list[Episode], rng: np.random.Generator
    ) -> tuple[Any, Any]:
        """Actions, and the controls that they are, one for each environment."""
        shares = np.zeros(len(episodes))
        if policy == "random":
            shares = rng.uniform(-1.0, 1.0, len(episodes))
        elif policy == "driven":
            shares = np.array([math.copysign(1.0, e.states[-1][1][-1]) for e in episodes])
        if space.shape == ():
            pushed_right = shares > 0.0
            return pushed_right.astype(space.dtype), np.where(pushed_right, 1, -1) * self.strongest
        actions = (shares * space.high).astype(space.dtype)
        return actions[:, None], actions * (self.strongest / space.high[0])


def _gymnasium_pendulum(seen: Any) -> list[State]:
    rows = np.asarray(seen, dtype=np.float64)
    return [((math.atan2(sine, cosine),), (speed,)) for cosine, sine, speed in rows.tolist()]


def _gymnasium_cart_pole(seen: Any) -> list[State]:
    rows = np.asarray(seen, dtype=np.float64)
    return [((x, angle), (speed, spin)) for x, speed, angle, spin in rows.tolist()]


def _suite_pendulum(seen: Any) -> list[State]:
    return _gymnasium_pendulum(np.concatenate([seen["orientation"], seen["velocity"]], axis=1))


def _suite_cart_pole(seen: Any) -> list[State]:
    rows = np.concatenate([seen["position"], seen["velocity"]], axis=1).tolist()
    return [((x, math.atan2(sine, cosine)), (speed, spin)) for x, cosine, sine, speed, spin in rows]


class Gymnasium(Library):
    """Reads parameters and state of ``env.unwrapped``; the state is set before each step."""

    title = "Gymnasium"
    package = "gymnasium"
    modules = ("gymnasium",)
    install = "pip install gymnasium"

    def subjects(self) -> Iterator[Subject]:
        """`Pendulum-v1` and `CartPole-v1`."""
        pendulum: Any = gymnasium.make("Pendulum-v1").unwrapped
        cart_pole: Any = gymnasium.make("CartPole-v1").unwrapped

        def turn(control: float) -> np.ndarray:
            return np.array([control], dtype=np.float32)

        def push(control: float) -> int:
            cart_pole.steps_beyond_terminated, cart_pole.force_mag = None, abs(control)
            return int(control > 0.0)

        note = "torques in float32, as its action space has them"
        step = _step(pendulum, turn)
        yield self.pendulum("Pendulum-v1", pendulum, pendulum.max_torque, step, note)
        yield self.cart_pole(
            "CartPole-v1", cart_pole, _step(cart_pole, push), cart_pole.kinematics_integrator,
            note="force_mag set to the force wanted",
        )  # fmt: skip


def _step(env: Any, action: Callable[[float], Any]) -> numerics.OneStep:
    """One control period under the action that stands for a control."""
    env.reset(seed=0)

    def advance_once(q: Components, v: Components, control: float) -> tuple[Components, Components]:
        env.state = np.array(join_state(q, v))
        env.step(action(control))
        return split_state(tuple(float(x) for x in env.state))

    return advance_once


class GymnasiumPhys2d(Library):
    """Calls ``transition`` of the functional environments, in float32 as JAX has it by default."""

    title = "Gymnasium phys2d"
    package = "gymnasium"
    modules = ("jax", "flax")
    install = "pip install jax flax"

    def subjects(self) -> Iterator[Subject]:
        """`phys2d/Pendulum-v0` and `phys2d/CartPole-v1`."""
        jnp = import_module("jax.numpy")
        module = import_module("gymnasium.envs.phys2d.pendulum")
        rod, rod_params = module.PendulumFunctional(), module.PendulumParams()
        module = import_module("gymnasium.envs.phys2d.cartpole")
        cart, params = module.CartPoleFunctional(), module.CartPoleParams()

        def turn(q: Any, v: Any, control: Any) -> tuple[Any, Any]:
            end = rod.transition(jnp.concatenate([q, v]), control, None, rod_params)
            return end[:1], end[1:]

        def push(q: Any, v: Any, control: Any) -> tuple[Any, Any]:
            given = params.replace(force_mag=abs(control[0]))
            state, right = jnp.stack(join_state(q, v)), (control[0] > 0.0).astype(int)
            return split_state(cart.transition(state, right, None, given))

        step = jax_step(turn)
        yield self.pendulum("phys2d/Pendulum-v0", rod_params, rod.max_torque, step)
        moment, expected = params.polemass_length, params.masspole * params.length
        wrong = (
            f"its polemass_length is {moment:g}, masspole × length is {expected:g}: its "
            "equations are not those of a cart-pole"
        )
        note = "" if abs(moment - expected) < 1e-9 else wrong
        yield self.cart_pole("phys2d/CartPole-v1", params, jax_step(push), width=32, note=note)


class Gymnax(Library):
    """Calls ``step_env`` from a state of our own, in float32 as JAX has it by default."""

    title = "gymnax"
    package = "gymnax"
    modules = ("gymnax",)
    install = "pip install 'gymnax<1' six"

    def subjects(self) -> Iterator[Subject]:
        """`Pendulum-v1` and `CartPole-v1`."""
        env, params = import_module("gymnax").make("Pendulum-v1")
        step = self._step(env, params, ("theta",))
        yield self.pendulum("Pendulum-v1", params, params.max_torque, step)
        env, params = import_module("gymnax").make("CartPole-v1")
        yield self.cart_pole(
            "CartPole-v1", params, self._step(env, params, ("x", "theta")), "Euler", width=32,
            note="force_mag set to the force wanted",
        )  # fmt: skip

    def _step(self, env: Any, params: Any, names: tuple[str, ...]) -> numerics.OneStep:
        """One control period; ``names`` are those of the coordinates."""
        key = import_module("jax").random.key(0)
        _, start = env.reset_env(key, params)
        speeds = tuple(f"{name}_dot" for name in names)

        def advance(q: Any, v: Any, control: Any) -> tuple[Any, Any]:
            state = start.replace(**dict(zip((*names, *speeds), (*q, *v), strict=True)))
            action, given = control, params
            if hasattr(params, "force_mag"):
                action = (control[0] > 0.0).astype(int)
                given = params.replace(force_mag=abs(control[0]))
            end = env.step_env(key, state, action, given)[1]
            return [getattr(end, name) for name in names], [getattr(end, name) for name in speeds]

        return jax_step(advance)


TASK = "Isaac-Cartpole-Direct"
EXPLICIT = "euler"
"""Under which the damping of the cart's actuator is not taken as in the task's own integrator."""

MASS, CENTRE, INERTIA = 1.0, 0.47, (0.06**2 + 1.0) / 12.0
"""Of the pole, kg, m, kg m^2: a box; the cart is as heavy."""

DAMPING = 10.0
"""Of the cart's actuator, N s/m."""

FORCE = 100.0
"""Of an action of 1, N."""


class Isaaclab(Library):
    """Isaac Lab's cart-pole on Newton, as it comes, and with its solver's `euler`.

    Its process sets any state. The pole tips to the other side than the plant's.
    """

    title = "Isaac Lab"
    package = "isaaclab"
    modules = ()
    apart = ISOLATED["isaaclab"]
    install = apart.command

    def subjects(self) -> Iterator[Subject]:
        """The task on two integrators."""
        home = find_testbed(f"isaaclab:{TASK}", {}).home
        for name, integrator in ((TASK, home.integrator), (f"{TASK}, {EXPLICIT}", EXPLICIT)):
            period = home.dt if home.control_period is None else home.control_period
            stated = Statement(period, round(period / home.dt), words=integrator)
            yield self.subject(
                name, isaaclab_plant(DAMPING), stated, FORCE,
                Settable(decision(integrator, home.dt)), width=32,
                note="MuJoCo gets the damping of its actuator as an actuator's",
            )  # fmt: skip


def isaaclab_plant(damping: float) -> CartPole:
    """The cart-pole with its pole as the point mass on a rod that moves alike.

    Args:
        damping: of the cart, N s/m.
    """
    length = (CENTRE**2 + INERTIA / MASS) / CENTRE
    mass = MASS * CENTRE / length
    return CartPole(
        cart_mass=2.0 * MASS - mass, mass=mass, length=length, gravity=9.81,
        mass_distribution="point", cart_damping=damping,
    )  # fmt: skip


def decision(integrator: str, dt: float, **arguments: Any) -> numerics.OneStep:
    """One decision of the task, from any state.

    Args:
        integrator: Isaac Lab's name.
        dt: step, s.
        arguments: of the testbed.
    """
    testbed = find_testbed(f"isaaclab:{TASK}", arguments)
    environments = make_checked(testbed, replace(testbed.home, integrator=integrator, dt=dt), 1)
    worker = environments.unwrapped.envs[0].unwrapped.worker  # type: ignore[attr-defined]

    def decide(q: Components, v: Components, control: float) -> tuple[Components, Components]:
        worker.call("put", lane=0, position=[q[0], -q[1]], velocity=[v[0], -v[1]])
        observation, *_ = worker.call("step", lane=0, action=[control / FORCE])
        return (observation[0], -observation[1]), (observation[2], -observation[3])

    return decide


class MujocoPlayground(Library):
    """Steps the environments as they are configured, from states of our own.

    Warp compiles its kernels for them, which takes a minute once on a machine.
    """

    title = "MuJoCo Playground"
    package = "playground"
    modules = ("mujoco_playground",)
    install = "pip install playground"

    def subjects(self) -> Iterator[Subject]:
        """`PendulumSwingup` and `CartpoleBalance`."""
        for name in ("PendulumSwingup", "CartpoleBalance"):
            # Without what Warp tells of the devices and of what it compiles.
            quiet = io.StringIO()
            with contextlib.redirect_stdout(quiet), contextlib.redirect_stderr(quiet):
                env = import_module("mujoco_playground").dm_control_suite.load(name)
                step = self._step(env)
            model = env.mj_model
            yield self.subject(
                name, plant_of(model), statement_of(model, env.n_substeps), max_control(model),
                Settable(step), width=32, note=f"MJX, {env.mjx_model.impl.value}",
            )  # fmt: skip

    def _step(self, env: Any) -> numerics.OneStep:
        """One control period, compiled."""
        start = env.reset(import_module("jax").random.key(0))

        def advance(q: Any, v: Any, action: Any) -> tuple[Any, Any]:
            end = env.step(start.replace(data=start.data.replace(qpos=q, qvel=v)), action).data
            return end.qpos, end.qvel

        step = jax_step(advance, float(env.mj_model.actuator_gear[0, 0]))
        still = (0.0,) * len(start.data.qpos)
        step(still, still, 0.0)
        return step
