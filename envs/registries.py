"""Registries: names of parts and environments, and where their classes are.

A new part is a file and a line here. An installed package adds parts by entry points of the groups
named here, and a user's own class is given as ``"module:Class"``.
"""

from __future__ import annotations

from typing import Final

import gymnasium as gym

from integ_gym.support.registry import Registry

PLANTS: Final = Registry(
    "plant",
    "acceleration",
    {
        "acrobot": "integ_gym.envs.plants.double_pendulum:Acrobot",
        "cart_pole": "integ_gym.envs.plants.cart_pole:CartPole",
        "chain": "integ_gym.envs.plants.chain:Chain",
        "elastic_pendulum": "integ_gym.envs.plants.elastic_pendulum:ElasticPendulum",
        "guided_quadrotor": "integ_gym.envs.plants.quadrotor:GuidedQuadrotor",
        "hopper": "integ_gym.envs.plants.hopper:Hopper",
        "pendulum": "integ_gym.envs.plants.pendulum:Pendulum",
        "quadrotor": "integ_gym.envs.plants.quadrotor:Quadrotor",
        "reacher": "integ_gym.envs.plants.double_pendulum:ReachingArm",
    },
    group="integ_gym.plants",
)

INTEGRATORS: Final = Registry(
    "integrator",
    "step",
    {
        "explicit_euler": "integ_gym.envs.integrators.euler:ExplicitEuler",
        "implicit_euler": "integ_gym.envs.integrators.implicit:ImplicitEuler",
        "implicit_midpoint": "integ_gym.envs.integrators.implicit:ImplicitMidpoint",
        "reference": "integ_gym.envs.integrators.reference:Reference",
        "rk4": "integ_gym.envs.integrators.rk4:RK4",
        "stormer_verlet": "integ_gym.envs.integrators.implicit:StormerVerlet",
        "symplectic_euler": "integ_gym.envs.integrators.euler:SymplecticEuler",
    },
    group="integ_gym.integrators",
)

TRUTH: Final = "reference"
"""The integrator that solves a plant to rounding."""

MAPS: Final = Registry(
    "one-step map",
    "step",
    {
        "bogacki_shampine3": "integ_gym.envs.engines.maps:BogackiShampine3",
        "dormand_prince5": "integ_gym.envs.engines.maps:DormandPrince5",
        "gauss_legendre4": "integ_gym.envs.engines.maps:GaussLegendre4",
        "heun": "integ_gym.envs.engines.maps:Heun",
        "implicit_euler_half_steps": "integ_gym.envs.engines.maps:ImplicitEulerHalfSteps",
        "kutta3": "integ_gym.envs.engines.maps:Kutta3",
        "radau_iia3": "integ_gym.envs.engines.maps:RadauIIA3",
        "radau_iia5": "integ_gym.envs.engines.maps:RadauIIA5",
        "symplectic_euler_implicit_damping": "integ_gym.envs.engines.maps:SymplecticEulerImplicitDamping",  # noqa: E501
        "symplectic_euler_implicit_velocity": "integ_gym.envs.engines.maps:SymplecticEulerImplicitVelocity",  # noqa: E501
        "symplectic_euler_sequential_damping": "integ_gym.envs.engines.maps:SymplecticEulerSequentialDamping",  # noqa: E501
    },
)
"""Maps that engines apply beside our own integrators; no choices for `integrator`."""

TASKS: Final = Registry(
    "task",
    "reward",
    {
        "acrobot_reach": "integ_gym.envs.tasks.acrobot:AcrobotReach",
        "acrobot_swing_up": "integ_gym.envs.tasks.acrobot:AcrobotSwingUp",
        "cart_pole_balance": "integ_gym.envs.tasks.cart_pole:CartPoleBalance",
        "cart_pole_swing_up": "integ_gym.envs.tasks.cart_pole:CartPoleSwingUp",
        "elastic_pendulum_quiet": "integ_gym.envs.tasks.elastic_pendulum:ElasticPendulumQuiet",
        "hopper_run": "integ_gym.envs.tasks.hopper:HopperRun",
        "pendulum_swing_up": "integ_gym.envs.tasks.pendulum:PendulumSwingUp",
        "quadrotor_hover": "integ_gym.envs.tasks.quadrotor:QuadrotorHover",
        "quadrotor_way_points": "integ_gym.envs.tasks.quadrotor:QuadrotorWayPoints",
        "reacher_follow": "integ_gym.envs.tasks.reacher:ReacherFollow",
    },
    group="integ_gym.tasks",
)

ENGINES: Final = Registry(
    "engine",
    "advance",
    {
        "casadi": "integ_gym.envs.engines.casadi:CasadiEngine",
        "dart": "integ_gym.envs.engines.dart:DartEngine",
        "drake": "integ_gym.envs.engines.drake:DrakeEngine",
        "isaaclab": "integ_gym.envs.engines.isaaclab:IsaaclabEngine",
        "mjx": "integ_gym.envs.engines.mjx:MjxEngine",
        "mujoco": "integ_gym.envs.engines.mujoco:MujocoEngine",
        "mujoco_warp": "integ_gym.envs.engines.warp:MujocoWarpEngine",
        "native": "integ_gym.envs.engines.stepping:NativeEngine",
        "newton": "integ_gym.envs.engines.newton:NewtonEngine",
        "pinocchio": "integ_gym.envs.engines.pinocchio:PinocchioEngine",
        "pybullet": "integ_gym.envs.engines.pybullet:PybulletEngine",
        "sapien": "integ_gym.envs.engines.sapien:SapienEngine",
    },
    group="integ_gym.engines",
)

TESTBEDS: Final = Registry(
    "testbed",
    "make",
    {
        "brax": "integ_gym.envs.testbeds.jax_tasks:BraxTask",
        "dm_control": "integ_gym.envs.testbeds.remote:DmControlTask",
        "isaaclab": "integ_gym.envs.testbeds.remote:IsaaclabTask",
        "playground": "integ_gym.envs.testbeds.jax_tasks:Playground",
    },
    group="integ_gym.testbeds",
)
"""Testbeds of other libraries' tasks, ``"library:task"``; each is made from the task's name."""

ENVIRONMENTS: Final = {
    "IntegAcrobot-v0": "integ_gym.envs.catalogue.acrobot:IntegAcrobot",
    "IntegAcrobotSwingUp-v0": "integ_gym.envs.catalogue.acrobot_swing_up:IntegAcrobotSwingUp",
    "IntegCartPole-v0": "integ_gym.envs.catalogue.cart_pole:IntegCartPole",
    "IntegCartPoleSwingUp-v0": "integ_gym.envs.catalogue.cart_pole_swing_up:IntegCartPoleSwingUp",
    "IntegElasticPendulum-v0": "integ_gym.envs.catalogue.elastic_pendulum:IntegElasticPendulum",
    "IntegHopper-v0": "integ_gym.envs.catalogue.hopper:IntegHopper",
    "IntegPendulum-v0": "integ_gym.envs.catalogue.pendulum:IntegPendulum",
    "IntegQuadrotor-v0": "integ_gym.envs.catalogue.quadrotor:IntegQuadrotor",
    "IntegReacher-v0": "integ_gym.envs.catalogue.reacher:IntegReacher",
}
"""Environment id to module and common stem of its `Env` and `VectorEnv` class."""

DEFAULT_DECISIONS: Final = {
    "IntegAcrobot-v0": 500,
    "IntegAcrobotSwingUp-v0": 1000,
    "IntegCartPole-v0": 500,
    "IntegCartPoleSwingUp-v0": 500,
    "IntegElasticPendulum-v0": 500,
    "IntegHopper-v0": 1000,
    "IntegPendulum-v0": 200,
    "IntegQuadrotor-v0": 500,
    "IntegReacher-v0": 1000,
}
"""Decisions of an episode with the default arguments, which the registered specs say."""


def register_environments() -> None:
    """Register every id once; a second call changes nothing."""
    for env_id, stem in ENVIRONMENTS.items():
        if env_id not in gym.registry:
            gym.register(
                env_id,
                entry_point=f"{stem}Env",
                vector_entry_point=f"{stem}VectorEnv",
                max_episode_steps=DEFAULT_DECISIONS[env_id],
            )
