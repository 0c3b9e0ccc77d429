"""``IntegAcrobotSwingUp-v0``: swing an acrobot up and keep it there."""

from __future__ import annotations

from typing import Any, ClassVar

from gymnasium import Env
from gymnasium.vector import VectorEnv

from ..environment import IntegEnv
from ..vector import IntegVectorEnv


class IntegAcrobotSwingUpEnv(IntegEnv, Env[Any, Any]):
    """Swing an acrobot up and keep it there, under a chosen discretization.

    ```python
    >>> import gymnasium as gym, integ_gym
    >>> env = gym.make("IntegAcrobotSwingUp-v0", integrator="rk4", dt=0.01, control_period=0.02)
    >>> observation, info = env.reset(seed=0)

    ```

    ## Description

    The plant is :class:`integ_gym.envs.plants.double_pendulum.Acrobot` with the parameters of Spong
    (1995), *The swing up control problem for the acrobot*: uniform rods of 1 kg, of 1 m and of 2 m.
    Standing upright takes 49 J, which the torque limit gives in several swings alone.

    | Contract | |
    |---|---|
    | State | (θ₁, θ₂, θ̇₁, θ̇₂), `env.unwrapped.state`, in the order of Gymnasium's acrobot; start from one with `reset(options={"state": …})` |
    | Observation | float32 (cos θ₁, sin θ₁, cos θ₂, sin θ₂, θ̇₁, θ̇₂) of the last sensor sample |
    | Action | `Box` (1,): torque, saturated at ±`max_torque`; the saturation is counted. With `actuator="position"` it is the target of a servo of θ₂, within ±`target_limit`; see *Position servos* in docs/reference/environments.md |
    | Rates | physics every `dt`, decisions every `control_period`, torque held in between (zero-order hold), samples every `sensor_period` |
    | Frame | first joint; θ₁ = 0 hanging, θ₂ = 0 straight, both positive counter-clockwise, unwrapped |
    | Units | SI: rad, rad/s, N m, kg, s, J |
    | Uncertainty | start distribution; Gaussian `observation_noise` on each sample of θ₁, θ̇₁, θ₂ and θ̇₂; when commands arrive, under `latency_jitter` and `hold_probability` |
    | Fallback | `hold` or `zero`, before the first command arrives and on non-finite actions; counted |
    | Metric | success: |wrapped θ₁ − π| < 0.2 rad and |wrapped θ₂| < 0.2 rad throughout the last 2 s; return in physical time |
    | Likeliest failure | a regulator that catches from states which, at a coarse step, fall on the truth |

    ## Action Space

    `Box(-max_torque, max_torque, (1,), float32)`, N m; cast to float64 before the physics.

    ## Observation Space

    `Box`, float32: cosines and sines within ±1, θ̇₁ and θ̇₂ within ±`max_speed` (unbounded without
    one).

    ## Rewards

    At most 1 per 0.02 s, proportional to `control_period`, of the state at the start of the control
    period and the mean over the period of the squared torque applied (under `action_latency` that
    of earlier decisions): ¼ (1 − cos θ₁) (1 − cos(θ₁ + θ₂)) · (1 − 0.1 (τ / `max_torque`)²).

    ## Starting State

    Every component uniform in ±0.1; `reset(options={"low": …, "high": …})` gives other bounds.

    ## Episode End

    Truncation after `duration`. Termination only by divergence (a component that is not finite in
    float32, or a speed above 1000 rad/s): the last good state is observed, and the reward is 0.

    ## Arguments

    Keyword arguments of `gym.make`; all are JSON-serialisable. Plant parameters of `make_vec` may
    be arrays with one value per environment.

    | Name | Default | Unit | Meaning |
    |---|---|---|---|
    | `integrator` | `"rk4"` | | one-step map such as `rk4`, as the engine calls it, or `module:Class` |
    | `dt` | 0.02 | s | integration step |
    | `control_period` | `None` | s | time between two decisions, a whole multiple of `dt`; `None`: `dt` |
    | `engine` | `"native"` | | what advances the plant: ours, or a simulator such as `mujoco` |
    | `solver` | `None` | | settings of the engine's solver, in its own names; `None`: the engine's defaults |
    | `duration` | 20.0 | s | truncation after ceil(duration / control_period) decisions |
    | `action_latency` | 0.0 | s | delay of every command, a whole multiple of `dt` |
    | `latency_jitter` | 0.0 | s | largest further delay of a command, drawn for each, a whole multiple of `dt` |
    | `hold_probability` | 0.0 | 1 | probability that a command does not arrive, drawn for each: the one before it holds |
    | `observation_latency` | 0.0 | s | age of every sample that is shown, a whole multiple of `dt` |
    | `sensor_period` | `None` | s | time between two samples, a whole multiple of `dt`; `None`: one per decision |
    | `observation_noise` | 0.0 | SI | standard deviation of each sensed state component |
    | `fallback` | `"hold"` | | `hold` the last control or `zero`, where no valid command acts |
    | `max_speed` | `None` | rad/s | clip on both speeds, in place of the next two; `None`: no clip of its own |
    | `max_speed_1` | `None` | rad/s | clip on the first joint's speed; `None`: no clip |
    | `max_speed_2` | `None` | rad/s | clip on the second joint's speed; `None`: no clip |
    | `start` | `"hanging"` | | start distribution |
    | `contact` | `"compliant"` | | there are no stops |
    | `render_mode` | `None` | | `"rgb_array"` or `"human"` |
    | `actuator` | `"effort"` | | `effort`: actions are torques; `position`: they are targets of servos, whose arguments are in *Position servos* |
    | `mass_1` | 1.0 | kg | mass of the first link |
    | `mass_2` | 1.0 | kg | mass of the second link |
    | `length_1` | 1.0 | m | first joint to second joint |
    | `length_2` | 2.0 | m | second joint to the tip |
    | `centre_1` | 0.5 | m | first joint to the first link's centre of mass |
    | `centre_2` | 1.0 | m | second joint to the second link's centre of mass |
    | `inertia_1` | 0.083 | kg m^2 | of the first link about its centre of mass |
    | `inertia_2` | 0.33 | kg m^2 | of the second link about its centre of mass |
    | `gravity` | 9.8 | m/s^2 | gravitational acceleration |
    | `damping` | 0.0 | N m s/rad | viscous damping at either joint |
    | `max_torque` | 20.0 | N m | torque limit of the motor |

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
    | `saturated` | | whether the action was at a bound or beyond |
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

    task_name = "acrobot_swing_up"
    defaults: ClassVar = {
        "integrator": "rk4",
        "dt": 0.02,
        "duration": 20.0,
        "length_2": 2.0,
        "centre_2": 1.0,
        "inertia_1": 0.083,
        "inertia_2": 0.33,
    }


class IntegAcrobotSwingUpVectorEnv(IntegVectorEnv, VectorEnv[Any, Any, Any]):
    """Vector form of :class:`IntegAcrobotSwingUpEnv`; see :class:`IntegVectorEnv` for its arguments."""

    env_class = IntegAcrobotSwingUpEnv
