"""integ-gym: Gymnasium environments in which the discretization is a constructor argument.

Importing this package registers ``IntegPendulum-v0``, ``IntegCartPole-v0``,
``IntegCartPoleSwingUp-v0`` and ``IntegElasticPendulum-v0``. What a script, a notebook or a part of
one's own needs is here, each name imported when it is first asked for.
"""

from typing import TYPE_CHECKING

from integ_gym.envs import register_environments
from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from integ_gym.envs import (
        ENVIRONMENTS,
        Applied,
        Command,
        Discretization,
        Engine,
        GymTestbed,
        IntegEnv,
        Integrator,
        IntegVectorEnv,
        Plant,
        Step,
        Success,
        Task,
        Testbed,
        along,
        functional,
        numerics,
        rediscretize,
    )
    from integ_gym.eval import check, evaluate, read_panel, run_panel, side_by_side
    from integ_gym.evidence import (
        EpisodeContext,
        EvidenceStore,
        RecordEvidence,
        RecordVectorEvidence,
    )
    from integ_gym.support import nonnegative, parameter, positive
    from integ_gym.train import (
        DiscretizationCallback,
        Policy,
        PPOConfig,
        SACConfig,
        TrainingEvidence,
        discretization_gap,
        save_policy,
        train_fleet,
        train_ppo,
        train_sac,
        write_sidecar,
    )
else:
    __getattr__, __dir__ = lazy_door(__name__)

register_environments()

__all__ = [
    "ENVIRONMENTS",
    "Applied",
    "Command",
    "Discretization",
    "DiscretizationCallback",
    "Engine",
    "EpisodeContext",
    "EvidenceStore",
    "GymTestbed",
    "IntegEnv",
    "IntegVectorEnv",
    "Integrator",
    "PPOConfig",
    "Plant",
    "Policy",
    "RecordEvidence",
    "RecordVectorEvidence",
    "SACConfig",
    "Step",
    "Success",
    "Task",
    "Testbed",
    "TrainingEvidence",
    "along",
    "check",
    "discretization_gap",
    "evaluate",
    "functional",
    "nonnegative",
    "numerics",
    "parameter",
    "positive",
    "read_panel",
    "rediscretize",
    "run_panel",
    "save_policy",
    "side_by_side",
    "train_fleet",
    "train_ppo",
    "train_sac",
    "write_sidecar",
]
