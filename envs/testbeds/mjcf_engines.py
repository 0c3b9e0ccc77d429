"""Engines of MuJoCo's family, which step a robot's compiled model in place of `mj_step`."""

from __future__ import annotations

import copy
import hashlib
from abc import ABC, abstractmethod
from collections.abc import Mapping
from functools import cache
from math import isclose
from typing import Any, ClassVar, Final

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from integ_gym.support.errors import InputError
from integ_gym.support.optional import load

from ..engines.mujoco_solver import NO_RESET, read_solver
from ..engines.newton import SETTABLE
from ..engines.simulator import silence_output
from ..rediscretized import integrator_numbers, integrator_of
from ..registries import ENGINES
from .boundaries import Array, MujocoBoundaries, Named, Scheme, name_components
from .mjcf_model import CompiledModel

READ: Final = ("qpos", "qvel", "act", "ctrl", "qfrc_applied", "xfrc_applied", "qacc_warmstart")
"""What an engine takes from MuJoCo's data before a step."""

WRITTEN: Final = (
    "qpos", "qvel", "act", "qacc", "qacc_warmstart", "qfrc_actuator", "qfrc_constraint"
)  # fmt: skip
"""What it puts there after it, with the time and the iterations of its solver."""

CONTACTS: Final = 64
"""That MuJoCo Warp makes room for."""

ROWS: Final = 256
"""Of constraints, likewise."""

Fields = Mapping[str, npt.NDArray[Any]]


def integrators_of_model(engine: str) -> dict[str, str]:
    """An engine's own names of the integrators that step a compiled model, to MuJoCo's."""
    known = {name.lower(): name for name in integrator_numbers()}
    found = {own: own.removeprefix("mujoco_").lower() for own in ENGINES.load(engine).maps}
    return {own: known[name] for own, name in found.items() if name in known}


class ModelEngine(ABC):
    """Takes a compiled model as it is and steps it.

    Sensors, sites, contacts and what the ledger tells of constraints are C MuJoCo's, computed in
    the states that the engine gives.

    Args:
        mujoco: the module.
        model: C MuJoCo's, with its timestep, integrator and solver.
        compiled: the file that it is of.

    Attributes:
        title: its name in sentences.
        reports: whether it tells the iterations of its solver.

    Raises:
        ValueError: for what the engine does not take, by its name.
    """

    title: ClassVar[str]
    reports: ClassVar[bool] = True

    def __init__(self, mujoco: Any, model: Any, compiled: CompiledModel) -> None:
        self._mujoco, self._model, self.compiled = mujoco, copy.copy(model), compiled
        flags = mujoco.mjtDisableBit
        own = self._model.opt
        own.disableflags &= ~int(getattr(flags, NO_RESET, 0))
        own.disableflags |= int(getattr(flags, "mjDSBL_SENSOR", 0))
        try:
            with silence_output():
                self.take()
        except (NotImplementedError, ValueError) as error:
            words = " ".join(str(error).split()).rstrip(".")
            raise InputError(f"{self.title} does not take this model: {words}") from error

    @abstractmethod
    def take(self) -> None:
        """Make what is stepped.

        Raises:
            NotImplementedError, ValueError: for what it does not take.
        """

    @abstractmethod
    def step(self, given: Fields) -> tuple[Fields, int]:
        """What :data:`WRITTEN` names after one timestep, and the iterations of the solver, or 0.

        Args:
            given: what :data:`READ` names.
        """

    def advance(self, model: Any, data: Any) -> None:
        """Stand in for `mj_step`."""
        found, iterations = self.step({name: getattr(data, name) for name in READ})
        self._mujoco.mj_forward(model, data)
        for name, values in found.items():
            getattr(data, name)[:] = values
        data.time += model.opt.timestep
        data.solver_niter[:] = 0
        data.solver_niter[0] = iterations


class MujocoModel(ModelEngine):
    """`mj_step`, which the others are compared with."""

    title: ClassVar[str] = "C MuJoCo"

    def take(self) -> None:
        """Make room for its state."""
        self._data = self._mujoco.MjData(self._model)

    def step(self, given: Fields) -> tuple[Fields, int]:
        """By C."""
        for name, values in given.items():
            getattr(self._data, name)[:] = values
        self._mujoco.mj_step(self._model, self._data)
        found = {name: getattr(self._data, name) for name in WRITTEN}
        return found, int(self._data.solver_niter[0])


class MjxModel(ModelEngine):
    """`mjx.step`, in float64 on the CPU."""

    title: ClassVar[str] = "MJX"
    reports: ClassVar[bool] = False

    def take(self) -> None:
        """Place the model; steps of all timesteps are one program."""
        jax, mjx = load("jax", "mjx"), load("mujoco.mjx", "mjx")
        if self._model.opt.noslip_iterations:
            raise NotImplementedError("noslip_iterations are not implemented")
        with jax.enable_x64(True):
            self._placed = mjx.put_model(self._model, impl="jax")
            self._data = mjx.make_data(self._model, impl="jax")
        self._jax = jax

    def step(self, given: Fields) -> tuple[Fields, int]:
        """By the compiled program."""
        with self._jax.enable_x64(True):
            found = _mjx_step()(self._placed, self._data, dict(given))
            return {name: np.asarray(x) for name, x in found.items()}, 0


@cache
def _mjx_step() -> Any:
    from ..engines.mjx_program import stepped

    def step(model: Any, data: Any, given: Any) -> Any:
        end = stepped(model, data.replace(**given))
        return {name: getattr(end, name) for name in WRITTEN}

    return load("jax", "mjx").jit(step)


class WarpModel(ModelEngine):
    """`mujoco_warp.step`, in float32 on the CPU."""

    title: ClassVar[str] = "MuJoCo Warp"

    def take(self) -> None:
        """Record the launches of a step."""
        self._warp, self._mjw = load("warp", "mujoco_warp"), load("mujoco_warp", "mujoco_warp")
        with self._warp.ScopedDevice("cpu"):
            model, data = self.place()
            model.opt.warn_overflow = 0
            self._mjw.step(model, data)
            with self._warp.ScopedCapture(device="cpu") as capture:
                self._mjw.step(model, data)
        self._graph, self._kept = capture.graph, (model, data)
        fields = dict.fromkeys((*READ, *WRITTEN, "solver_niter", "overflow"))
        self._memory = {name: getattr(data, name).numpy() for name in fields}
        kinds = self._mjw.OverflowType
        self._lost = ~int(kinds.ITERATIONS | kinds.LS_ITERATIONS)

    def place(self) -> tuple[Any, Any]:
        """MuJoCo Warp's model, and data for one world."""
        data = self._mjw.make_data(self._model, nconmax=CONTACTS, njmax=ROWS)
        return self._mjw.put_model(self._model), data

    def step(self, given: Fields) -> tuple[Fields, int]:
        """By the recorded launches."""
        memory = self._memory
        for name, values in given.items():
            memory[name][0] = values
        memory["overflow"][0] = 0
        self._warp.capture_launch(self._graph)
        if lost := int(memory["overflow"][0]) & self._lost:
            kind = self._mjw.OverflowType(lost).name
            raise InputError(
                f"{self.title} has room for {CONTACTS} contacts and {ROWS} rows of constraints, "
                f"and a state has more ({kind}); leave this engine out"
            )
        return {name: memory[name][0] for name in WRITTEN}, int(memory["solver_niter"][0])


SAME: Final = {
    "body": "mass pos quat ipos gravcomp",
    "jnt": "type pos axis stiffness limited solref solimp margin",
    "dof": "armature damping frictionloss solref solimp",
    "actuator": "trntype trnid dyntype gaintype biastype dynprm gainprm biasprm gear ctrllimited "
    "ctrlrange forcelimited forcerange",
    "pair": "dim solref solimp margin gap friction",
    "eq": "type obj1id obj2id data solref solimp",
    "tendon": "range limited stiffness damping frictionloss",
}
"""What must be the same in a model that another engine has imported, by kind of element."""

OF_CONTACTS: Final = (
    "type bodyid contype conaffinity condim priority friction solmix solref solimp margin"
)
"""Likewise, of geoms that collide."""


class NewtonModel(WarpModel):
    """Newton's own import of the model, stepped by MuJoCo Warp as its `SolverMuJoCo` does.

    What it imports otherwise is refused by the name of MuJoCo's field.
    """

    title: ClassVar[str] = "Newton"

    def place(self) -> tuple[Any, Any]:
        """MuJoCo Warp's model and data that the solver holds."""
        newton, model = load("newton", "newton"), self._model
        settings = read_solver(self._mujoco, model)
        builder = newton.ModelBuilder(up_axis=newton.Axis.Z)
        builder.rigid_gap = 0.0
        newton.solvers.SolverMuJoCo.register_custom_attributes(builder)
        builder.add_mjcf(
            self.compiled.xml,
            ctrl_direct=True,
            path_resolver=lambda _, file: str(self.compiled.folder.absolute() / file),
        )
        solver = newton.solvers.SolverMuJoCo(
            builder.finalize(skip_all_validations=True),
            integrator=integrator_of(model).lower(),
            njmax=ROWS,
            nconmax=CONTACTS,
            disable_sensors=True,
            kinematic_switchable_roots=False,
            **{name: settings[name] for name in SETTABLE},
        )
        imported = solver.mj_model
        for name, value in read_solver(self._mujoco, imported).items():
            own = settings[name]
            if not (isclose(own, value) if isinstance(own, float) else own == value):
                raise NotImplementedError(f"`solver.{name}` of {own} becomes {value}")
        for name, own, there in _pairs_of_fields(model, imported):
            if np.shape(own) != np.shape(there) or not np.allclose(own, there, 1e-5, 1e-7):
                raise NotImplementedError(f"its import changes {name}")
        solver.mjw_model.opt.timestep.fill_(float(model.opt.timestep))
        self._solver = solver
        return solver.mjw_model, solver.mjw_data


def _pairs_of_fields(one: Any, other: Any) -> list[tuple[str, Any, Any]]:
    """Name, and values in both models, of what must be the same."""
    pairs = [
        (f"{kind}_{name}", getattr(one, f"{kind}_{name}"), getattr(other, f"{kind}_{name}"))
        for kind, names in SAME.items()
        for name in names.split()
    ]
    ranges = [x.jnt_range[x.jnt_limited.astype(bool)] for x in (one, other)]
    collide = [(x.geom_contype | x.geom_conaffinity).astype(bool) for x in (one, other)]
    pairs.append(("body_inertia", _inertias(one), _inertias(other)))
    pairs += [("jnt_range", *ranges), ("qpos0", one.qpos0, other.qpos0)]
    pairs += [("gravity", one.opt.gravity, other.opt.gravity)]
    pairs += [("density", one.opt.density, other.opt.density)]
    for name in OF_CONTACTS.split():
        own, there = (getattr(x, f"geom_{name}") for x in (one, other))
        pairs.append((f"geom_{name}", own[collide[0]], there[collide[1]]))
    pairs.append(("geom_pos", _places(one, collide[0]), _places(other, collide[1])))
    return pairs


def _places(model: Any, geoms: npt.NDArray[np.bool_]) -> npt.NDArray[np.float64]:
    """Where geoms are in their bodies: corners of meshes, whose frames are each compiler's own,
    and ends of the axes of others, (points, 3), m."""
    turn, mujoco, found = np.zeros(9), load("mujoco", "mujoco"), []
    for geom in np.flatnonzero(geoms):
        mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
        points, mesh = np.eye(3), int(model.geom_dataid[geom])
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
            first = model.mesh_vertadr[mesh]
            points = model.mesh_vert[first : first + model.mesh_vertnum[mesh]]
        found.append(model.geom_pos[geom] + points @ turn.reshape(3, 3).T)
    return np.concatenate(found) if found else np.zeros((0, 3))


def _inertias(model: Any) -> npt.NDArray[np.float64]:
    """Of all bodies in their own frames, (bodies, 3, 3), kg m²."""
    turn, mujoco = np.zeros((model.nbody, 9)), load("mujoco", "mujoco")
    for row, quaternion in zip(turn, model.body_iquat, strict=True):
        mujoco.mju_quat2Mat(row, quaternion)
    turns = turn.reshape(-1, 3, 3)
    whole: npt.NDArray[np.float64] = turns * model.body_inertia[:, None] @ turns.swapaxes(1, 2)
    return whole


MODEL_ENGINES: Final[dict[str, type[ModelEngine]]] = {
    "mjx": MjxModel,
    "mujoco_warp": WarpModel,
    "newton": NewtonModel,
}
"""Engine to what steps a model with it, by the names of :data:`ENGINES`."""

_MADE: dict[tuple[str, str], ModelEngine] = {}
KEPT: Final = 8
"""Stepped models that are kept for the lanes of a cell and for the next."""


def engine_of_model(engine: str, model: Any, compiled: CompiledModel) -> ModelEngine:
    """What steps a model with an engine; the same for equal models.

    Raises:
        ModuleNotFoundError: for an engine that is not installed, with the command.
        ValueError: for what the engine does not take.
    """
    mujoco = load("mujoco", "mujoco")
    content = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, content)
    key = engine, hashlib.sha256(content.tobytes()).hexdigest()
    if key not in _MADE:
        kind = MujocoModel if engine == "mujoco" else MODEL_ENGINES[engine]
        stepped = kind(mujoco, model, compiled)
        if len(_MADE) >= KEPT:
            _MADE.pop(next(iter(_MADE)))
        _MADE[key] = stepped
    return _MADE[key]


CONVERGED: Final = {"iterations": 100, "ls_iterations": 50}
"""Of the solver, where the model is compared and not where a solver is stopped."""


class ModelBoundaries(MujocoBoundaries):
    """Of a robot, by one step of its engine, whose solver may go on until it has converged.

    Args:
        env: the robot's environment.
        engine: of it.
    """

    scheme: Scheme

    def __init__(self, env: gym.Env[Any, Any], engine: str) -> None:
        super().__init__(env)
        self.width = int(ENGINES.load(engine).width)
        own = integrator_of(self._model), float(self._model.opt.timestep)
        self.scheme = Scheme(engine, *own)
        self._explicit = self.scheme._replace(integrator="Euler")
        self._compiled = env.unwrapped.testbed.compiled  # type: ignore[attr-defined]
        self._steppers: dict[Scheme, ModelEngine] = {}

    def force(self, state: Array, command: Array) -> Named | None:
        """`qfrc_actuator`."""
        if len(command) != self._model.nu:
            return None
        return self._name(self._step_once(state, self._explicit, ctrl=command)["qfrc_actuator"])

    def acceleration(self, state: Array, force: Array) -> Named | None:
        """`qacc`."""
        found = self._step_under(state, force, self._explicit)
        return None if found is None else self._name(found["qacc"])

    def constraint(self, state: Array, force: Array) -> Named | None:
        """`qfrc_constraint`: of contacts, limits of joints, friction in them."""
        found = self._step_under(state, force, self._explicit)
        return None if found is None else self._name(found["qfrc_constraint"])

    def step(self, state: Array, given: tuple[Array, Scheme]) -> Named | None:
        """Of `qvel`."""
        force, scheme = given
        found = self._step_under(state, force, scheme._replace(engine=self.scheme.engine))
        return None if found is None else self._name(found["qvel"] - state[self._model.nq :])

    def _name(self, values: Array) -> Named:
        return name_components(self._axes, values)

    def _step_under(self, state: Array, force: Array, scheme: Scheme) -> Fields | None:
        """One step under the force alone: what actuators do without a command is taken off."""
        known = integrators_of_model(self.scheme.engine).values()
        if len(force) != self._model.nv or scheme.integrator not in known:
            return None
        idle = self._step_once(state, self._explicit)["qfrc_actuator"].copy()
        return self._step_once(state, scheme, qfrc_applied=force - idle)

    def _step_once(self, state: Array, scheme: Scheme, **inputs: Array) -> Fields:
        if scheme not in self._steppers:
            model, number = copy.copy(self._model), integrator_numbers()[scheme.integrator]
            for name, value in {**CONVERGED, "integrator": number, "timestep": scheme.dt}.items():
                setattr(model.opt, name, value)
            self._steppers[scheme] = engine_of_model(scheme.engine, model, self._compiled)
        self._place(state, **inputs)
        self._data.qacc_warmstart[:] = 0.0
        return self._steppers[scheme].step({name: getattr(self._data, name) for name in READ})[0]
