"""integ-gym: Gymnasium environments in which the discretization is a constructor argument.

Importing this package registers ``IntegPendulum-v0``, ``IntegCartPole-v0``,
``IntegCartPoleSwingUp-v0``, ``IntegElasticPendulum-v0``, ``IntegQuadrotor-v0``,
``IntegReacher-v0``, ``IntegHopper-v0``, ``IntegAcrobot-v0`` and ``IntegAcrobotSwingUp-v0``. What a
script, a notebook or a part of one's own needs is here. Each name is imported when it is first
asked for; ``__init__.pyi`` says the same to type checkers.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from integ_gym.envs.registries import register_environments

_NAMESPACES = {
    "functional": "integ_gym.envs.functional",
    "numerics": "integ_gym.envs.numerics",
}

_MODULES = {
    "along": "integ_gym.envs.ops.ops",
    "Applied": "integ_gym.envs.testbeds.gym_testbed",
    "Boundaries": "integ_gym.envs.testbeds.boundaries",
    "check": "integ_gym.eval.loss_check",
    "Command": "integ_gym.envs.tasks.interface",
    "compare_contracts": "integ_gym.eval.contract",
    "ContactFrame": "integ_gym.envs.plants.contact",
    "ContactPoint": "integ_gym.envs.plants.contact",
    "Discretization": "integ_gym.envs.settings",
    "discretization_gap": "integ_gym.train.monitoring",
    "DiscretizationCallback": "integ_gym.train.sb3_callback",
    "Engine": "integ_gym.envs.engines.stepping",
    "ENVIRONMENTS": "integ_gym.envs.registries",
    "EpisodeContext": "integ_gym.evidence.labels",
    "evaluate": "integ_gym.eval.panel.existing",
    "EvidenceStore": "integ_gym.evidence.store",
    "GymTestbed": "integ_gym.envs.testbeds.gym_testbed",
    "IntegGymError": "integ_gym.support.errors",
    "IntegEnv": "integ_gym.envs.environment",
    "Integrator": "integ_gym.envs.integrators.interface",
    "IntegVectorEnv": "integ_gym.envs.vector",
    "MjcfTestbed": "integ_gym.envs.testbeds.mjcf",
    "nonnegative": "integ_gym.support.parameters",
    "parameter": "integ_gym.support.parameters",
    "Plant": "integ_gym.envs.plants.interface",
    "Policy": "integ_gym.train.policy",
    "positive": "integ_gym.support.parameters",
    "PPOConfig": "integ_gym.train.ppo",
    "read_panel": "integ_gym.eval.panel.result",
    "RecordEvidence": "integ_gym.evidence.recorder",
    "RecordVectorEvidence": "integ_gym.evidence.vector_recorder",
    "rediscretize": "integ_gym.envs.rediscretized",
    "run_panel": "integ_gym.eval.panel.run",
    "SACConfig": "integ_gym.train.sac",
    "save_policy": "integ_gym.train.policy_files.writing",
    "side_by_side": "integ_gym.eval.watch",
    "Step": "integ_gym.envs.integrators.interface",
    "Success": "integ_gym.envs.testbeds.gym_testbed",
    "Task": "integ_gym.envs.tasks.interface",
    "Testbed": "integ_gym.envs.testbeds.gym_testbed",
    "train_fleet": "integ_gym.train.fleet.training",
    "train_ppo": "integ_gym.train.runs",
    "train_sac": "integ_gym.train.runs",
    "TrainingEvidence": "integ_gym.train.config",
    "write_sidecar": "integ_gym.train.policy_files.writing",
}

_EXTRAS = {
    "check": "panel",
    "compare_contracts": "report",
    "DiscretizationCallback": "train",
    "evaluate": "report",
    "read_panel": "report",
    "run_panel": "panel",
    "side_by_side": "render,report",
    "train_fleet": "fleet",
    "train_ppo": "train",
    "train_sac": "train",
}
"""Name to the smallest extra that it works with."""

__all__ = sorted([*_MODULES, *_NAMESPACES])

register_environments()


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("integ-gym")
    if name in _NAMESPACES:
        return import_module(_NAMESPACES[name])
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        value = globals()[name] = getattr(import_module(_MODULES[name]), name)
    except ModuleNotFoundError as error:
        if name not in _EXTRAS:
            raise
        from integ_gym.support.optional import missing_package

        raise missing_package(str(error.name), _EXTRAS[name]) from error
    return value


def __dir__() -> list[str]:
    return __all__
