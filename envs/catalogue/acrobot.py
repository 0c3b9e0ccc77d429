"""``IntegAcrobot-v0``: swing the tip of a double pendulum up, as Gymnasium's ``Acrobot-v1``."""

from __future__ import annotations

from math import pi
from typing import Any, ClassVar

from gymnasium import Env
from gymnasium.vector import VectorEnv

from ..environment import IntegEnv
from ..vector import IntegVectorEnv


class IntegAcrobotEnv(IntegEnv, Env[Any, Any]):
    """Swing the tip of an acrobot up, under a chosen discretization.

    ```python
    >>> import gymnasium as gym, integ_gym
    >>> env = gym.make("IntegAcrobot-v0", integrator="rk4", dt=0.05, control_period=0.2)
    >>> observation, info = env.reset(seed=0)

    ```

    ## Description

    The plant is :class:`integ_gym.envs.plants.double_pendulum.Acrobot`: two links, of which the
    first hangs on a fixed joint and the second on the first; a motor turns the second. With the
    defaults the environment is Gymnasium's ``Acrobot-v1``, whose inertias of 1 kg m² belong to
    heavier rods than its masses: a uniform rod of 1 kg and 1 m has 1/12 kg m².

    | Contract | |
    |---|---|
    | State | (θ₁, θ₂, θ̇₁, θ̇₂), `env.unwrapped.state`, in Gymnasium's order; start from one with `reset(options={"state": …})` |
    | Observation | float32 (cos θ₁, sin θ₁, cos θ₂, sin θ₂, θ̇₁, θ̇₂) of the last sensor sample |
    | Action | `Discrete(3)`: torque −`torque`, 0 or +`torque`; others raise |
    | Rates | physics every `dt`, decisions every `control_period`, torque held in between (zero-order hold), samples every `sensor_period` |
    | Frame | first joint; θ₁ = 0 hanging, θ₂ = 0 straight, both positive counter-clockwise, unwrapped |
    | Units | SI: rad, rad/s, N m, kg, s, J |
    | Uncertainty | start distribution; Gaussian `observation_noise` on each sample of θ₁, θ̇₁, θ₂ and θ̇₂; when commands arrive, under `latency_jitter` and `hold_probability` |
    | Fallback | `hold` or `zero` (0 N m), before the first command arrives and on non-finite actions; counted |
    | Metric | success: the tip is above the line within `duration`; return in physical time |
    | Likeliest failure | at 0.2 s RK4's error moves almost half as much energy as a motor that swings up well |

    ## Action Space

    `Discrete(3)`: 0 turns the second link clockwise, 1 leaves it, 2 turns it counter-clockwise.

    ## Observation Space

    `Box`, float32: cosines and sines within ±1, θ̇₁ and θ̇₂ within ±`max_speed_1` and ±`max_speed_2`,
    or ±`max_speed` where that is given (unbounded without one).

    ## Rewards

    −1 per 0.2 s, proportional to `control_period`: at 0.2 s it is that of ``Acrobot-v1``. The
    control period that ends at the goal pays 0.

    ## Starting State

    Every component uniform in ±0.1; `reset(options={"low": …, "high": …})` gives other bounds.

    ## Episode End

    Termination where −cos θ₁ − cos(θ₁ + θ₂) > 1, checked at control instants: the goal, and the
    only success. Truncation after `duration`. Termination also by divergence (a component that is
    not finite in float32, or a speed above 1000 rad/s): the last good state is observed, and the
    reward is that of never coming to the goal.

    ## Arguments

    Keyword arguments of `gym.make`; all are JSON-serialisable. Plant parameters of `make_vec` may
    be arrays with one value per environment.

    | Name | Default | Unit | Meaning |
    |---|---|---|---|
    | `integrator` | `"rk4"` | | one-step map such as `rk4`, as the engine calls it, or `module:Class` |
    | `dt` | 0.2 | s | integration step |
    | `control_period` | `None` | s | time between two decisions, a whole multiple of `dt`; `None`: `dt` |
    | `engine` | `"native"` | | what advances the plant: ours, or a simulator such as `mujoco` |
    | `solver` | `None` | | settings of the engine's solver, in its own names; `None`: the engine's defaults |
    | `duration` | 100.0 | s | truncation after ceil(duration / control_period) decisions |
    | `action_latency` | 0.0 | s | delay of every command, a whole multiple of `dt` |
    | `latency_jitter` | 0.0 | s | largest further delay of a command, drawn for each, a whole multiple of `dt` |
    | `hold_probability` | 0.0 | 1 | probability that a command does not arrive, drawn for each: the one before it holds |
    | `observation_latency` | 0.0 | s | age of every sample that is shown, a whole multiple of `dt` |
    | `sensor_period` | `None` | s | time between two samples, a whole multiple of `dt`; `None`: one per decision |
    | `observation_noise` | 0.0 | SI | standard deviation of each sensed state component |
    | `fallback` | `"hold"` | | `hold` the last control or `zero`, where no valid command acts |
    | `max_speed` | `None` | rad/s | clip on both speeds, in place of the next two; `None`: no clip of its own |
    | `max_speed_1` | 4 π | rad/s | clip on the first joint's speed; `None`: no clip |
    | `max_speed_2` | 9 π | rad/s | clip on the second joint's speed; `None`: no clip |
    | `start` | `"hanging"` | | start distribution |
    | `contact` | `"compliant"` | | there are no stops |
    | `render_mode` | `None` | | `"rgb_array"` or `"human"` |
    | `mass_1` | 1.0 | kg | mass of the first link |
    | `mass_2` | 1.0 | kg | mass of the second link |
    | `length_1` | 1.0 | m | first joint to second joint |
    | `length_2` | 1.0 | m | second joint to the tip |
    | `centre_1` | 0.5 | m | first joint to the first link's centre of mass |
    | `centre_2` | 0.5 | m | second joint to the second link's centre of mass |
    | `inertia_1` | 1.0 | kg m^2 | of the first link about its centre of mass |
    | `inertia_2` | 1.0 | kg m^2 | of the second link about its centre of mass |
    | `gravity` | 9.8 | m/s^2 | gravitational acceleration |
    | `damping` | 0.0 | N m s/rad | viscous damping at either joint |
    | `torque` | 1.0 | N m | magnitude of the torque |

    ## Info

    The same keys after every reset and step; energies in J over the control period.

    | Key | Unit | Meaning |
    |---|---|---|
    | `time` | s | since the start of the episode |
    | `energy` | J | kinetic + potential; zero at rest hanging |
    | `actuator_work` | J | Σ over sub-steps of control × displacement, exact |
    | `dissipated` | J | taken out by damping, integrated with the motion |
    | `contact_loss` | J | 0: there are no stops |
    | `clip_loss` | J | taken out by speed limits |
    | `energy_residual` | J | ΔE − work + dissipated + clip_loss: what numerical error put in or took out |
    | `control` | N m | in force at the end of the period |
    | `commanded` | N m | asked for by this decision, after saturation and fallback |
    | `saturated` | | never true: there are no bounds to be beyond |
    | `fallback_used` | | whether the fallback acted in this period |
    | `sensor_time` | s | when the observed sample was taken |
    | `penetration` | m | 0: there are no stops |
    | `contact_force` | N | 0: there are no stops |
    | `goal_since` | s | since when the state has been at the goal; −1 while it is not |
    | `success` | | true at the end of an episode that succeeded |
    | `solver_iterations` | | most iterations of any sub-step |
    | `solver_residual` | | largest scaled residual of any sub-step |
    | `solver_status` | | `ok`, `not_converged`, `diverged`, or `not_reported` by an engine that does not tell |

    ## Version History

    * v0: initial version.
    """

    task_name = "acrobot_reach"
    defaults: ClassVar = {
        "integrator": "rk4",
        "dt": 0.2,
        "duration": 100.0,
        "max_speed_1": 4.0 * pi,
        "max_speed_2": 9.0 * pi,
    }


class IntegAcrobotVectorEnv(IntegVectorEnv, VectorEnv[Any, Any, Any]):
    """Vector form of :class:`IntegAcrobotEnv`; see :class:`IntegVectorEnv` for its arguments."""

    env_class = IntegAcrobotEnv
