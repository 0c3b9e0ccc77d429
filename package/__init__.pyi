from integ_gym.envs import functional as functional
from integ_gym.envs import numerics as numerics
from integ_gym.envs.engines.stepping import Engine as Engine
from integ_gym.envs.environment import IntegEnv as IntegEnv
from integ_gym.envs.integrators.interface import Integrator as Integrator
from integ_gym.envs.integrators.interface import Step as Step
from integ_gym.envs.ops.ops import along as along
from integ_gym.envs.plants.interface import Plant as Plant
from integ_gym.envs.rediscretized import rediscretize as rediscretize
from integ_gym.envs.registries import ENVIRONMENTS as ENVIRONMENTS
from integ_gym.envs.settings import Discretization as Discretization
from integ_gym.envs.tasks import Command as Command
from integ_gym.envs.tasks import Task as Task
from integ_gym.envs.testbeds.boundaries import Boundaries as Boundaries
from integ_gym.envs.testbeds.gym_testbed import Applied as Applied
from integ_gym.envs.testbeds.gym_testbed import GymTestbed as GymTestbed
from integ_gym.envs.testbeds.gym_testbed import Success as Success
from integ_gym.envs.testbeds.gym_testbed import Testbed as Testbed
from integ_gym.envs.testbeds.mjcf import MjcfTestbed as MjcfTestbed
from integ_gym.envs.vector import IntegVectorEnv as IntegVectorEnv
from integ_gym.eval.contract import compare_contracts as compare_contracts
from integ_gym.eval.loss_check import check as check
from integ_gym.eval.panel.existing import evaluate as evaluate
from integ_gym.eval.panel.result import read_panel as read_panel
from integ_gym.eval.panel.run import run_panel as run_panel
from integ_gym.eval.watch import side_by_side as side_by_side
from integ_gym.evidence.labels import EpisodeContext as EpisodeContext
from integ_gym.evidence.recorder import RecordEvidence as RecordEvidence
from integ_gym.evidence.store import EvidenceStore as EvidenceStore
from integ_gym.evidence.vector_recorder import (
    RecordVectorEvidence as RecordVectorEvidence,
)
from integ_gym.support.errors import IntegGymError as IntegGymError
from integ_gym.support.parameters import nonnegative as nonnegative
from integ_gym.support.parameters import parameter as parameter
from integ_gym.support.parameters import positive as positive
from integ_gym.train.config import TrainingEvidence as TrainingEvidence
from integ_gym.train.fleet.training import train_fleet as train_fleet
from integ_gym.train.monitoring import discretization_gap as discretization_gap
from integ_gym.train.policy import Policy as Policy
from integ_gym.train.policy_files.writing import save_policy as save_policy
from integ_gym.train.policy_files.writing import write_sidecar as write_sidecar
from integ_gym.train.ppo import PPOConfig as PPOConfig
from integ_gym.train.runs import train_ppo as train_ppo
from integ_gym.train.runs import train_sac as train_sac
from integ_gym.train.sac import SACConfig as SACConfig
from integ_gym.train.sb3_callback import DiscretizationCallback as DiscretizationCallback

__version__: str
