"""``IntegReacher-v0``: an arm with position servos follows a moving marker."""

from __future__ import annotations

from typing import Any, ClassVar

from gymnasium import Env
from gymnasium.vector import VectorEnv

from ..environment import IntegEnv
from ..vector import IntegVectorEnv


class IntegReacherEnv(IntegEnv, Env[Any, Any]):
    """Follow a moving marker with the tip of a servo-driven arm, under a chosen discretization.

    ```python
    >>> import gymnasium as gym, integ_gym
    >>> env = gym.make("IntegReacher-v0", integrator="rk4", dt=0.01, control_period=0.02)
    >>> observation, info = env.reset(seed=0)
    >>> observation, reward, terminated, truncated, info = env.step([-0.5, 1.5])
    >>> info["theta_1_target_commanded"], info["theta_2_target_commanded"]
    (-0.5, 1.5)

    ```

    ## Description

    The plant is :class:`integ_gym.envs.plants.double_pendulum.ReachingArm`: two uniform rods of 1 kg
    and 0.5 m on a table, so that gravity does nothing, with a servo on either joint. The actions are
    the servos' targets; see *Position servos* in docs/reference/environments.md. The marker goes round
    in a circle of 0.25 m about (0, −0.6) m, at 0.79 m/s where it is fastest. Its phase is a coordinate of
    the plant that nothing acts on, exact in every integrator; in engines of rigid bodies it goes on
    beside them.

    The least of the arm's two inertias is 0.017 kg m² where it is straight, 0.043 where the marker is
    farthest and 0.064 with the elbow at a right angle. So the servos' damping alone makes rates of 63 to
    240 1/s: explicit Euler and symplectic Euler are unstable from a step of 0.008 s straight and 0.022 s at
    the farthest marker, RK4 from 0.012 s and 0.030 s, implicit integrators never. What is unstable
    trembles at the torque limits, and may follow the marker all the same.

    | Contract | |
    |---|---|
    | State | (θ₁, θ̇₁, θ₂, θ̇₂, phase and rate of the marker), `env.unwrapped.state`; start from one with `reset(options={"state": …})` |
    | Observation | float32 (cos θ₁, sin θ₁, cos θ₂, sin θ₂, θ̇₁, θ̇₂, marker's x, z, ẋ, ż) of the last sensor sample |
    | Action | `Box` (2,): targets of θ₁ and θ₂, saturated to ±`target_limit`; the saturation is counted. With `actuator="effort"` torques, to ±`max_torque` |
    | Rates | physics every `dt`, decisions every `control_period`, targets held in between (zero-order hold), servos as `servo` says, samples every `sensor_period` |
    | Frame | first joint; x to the right, z upwards on the table; θ₁ = 0 along −z, θ₂ = 0 straight, both positive counter-clockwise, unwrapped |
    | Units | SI: rad, rad/s, m, m/s, N m, kg, s, J |
    | Uncertainty | start distribution; Gaussian `observation_noise` on each sample of every component of the state; when commands arrive, under `latency_jitter` and `hold_probability` |
    | Fallback | `hold` or `zero`, before the first command arrives and on non-finite actions; counted. Zero is a target, too: the servos straighten the arm |
    | Metric | success: tip within 0.05 m of the marker throughout the last 2 s; return in physical time |
    | Likeliest failure | a step beyond the servos' stability limit, where the arm trembles at its torque limits |

    ## Action Space

    `Box(-target_limit, target_limit, (2,), float32)`, rad; cast to float64 before the physics.

    ## Observation Space

    `Box`, float32: cosines and sines in ±1, θ̇₁ and θ̇₂ within ±`max_speed` (unbounded without one), the
    marker's unbounded.

    ## Rewards

    At most 1 per 0.02 s, proportional to `control_period`, of the state at the start of the control
    period and the mean over the period of the servos' squared torques: (1 − 0.1 E) / (1 + D / (0.1 m)²)
    with E = (τ₁² + τ₂²) / (2 `max_torque`²) and D the squared distance of the tip from the marker.

    ## Starting State

    `start="bent"`: θ₁ uniform in ±0.5 rad and θ₂ from 0.5 to 2 rad, at rest; the marker anywhere on its
    circle, at any rate up to once round in `marker_period`, either way.

    ## Episode End

    Truncation after `duration`. Termination only by divergence (a component that is not finite in
    float32, or a speed above 1000 rad/s): the last good state is observed, and the reward is 0.

    ## Arguments

    Keyword arguments of `gym.make`; all are JSON-serialisable. Plant parameters of `make_vec` may
    be arrays with one value per environment.

    | Name | Default | Unit | Meaning |
    |---|---|---|---|
    | `integrator` | `"rk4"` | | one-step map such as `rk4`, as the engine calls it, or `module:Class` |
    | `dt` | 0.01 | s | integration step |
    | `control_period` | `None` | s | time between two decisions, a whole multiple of `dt`; `None`: `dt` |
    | `engine` | `"native"` | | what advances the plant: ours, or a simulator such as `mujoco` |
    | `solver` | `None` | | settings of the engine's solver, in its own names; `None`: the engine's defaults |
    | `duration` | 10.0 | s | truncation after ceil(duration / control_period) decisions |
    | `action_latency` | 0.0 | s | delay of every command, a whole multiple of `dt` |
    | `latency_jitter` | 0.0 | s | largest further delay of a command, drawn for each, a whole multiple of `dt` |
    | `hold_probability` | 0.0 | 1 | probability that a command does not arrive, drawn for each: the one before it holds |
    | `observation_latency` | 0.0 | s | age of every sample that is shown, a whole multiple of `dt` |
    | `sensor_period` | `None` | s | time between two samples, a whole multiple of `dt`; `None`: one per decision |
    | `observation_noise` | 0.0 | SI | standard deviation of each sensed state component |
    | `fallback` | `"hold"` | | `hold` the last control or `zero`, where no valid command acts |
    | `max_speed` | `None` | rad/s | clip on both joints' speeds, in place of the next two; `None`: no clip of its own |
    | `max_speed_1` | `None` | rad/s | clip on the first joint's speed; `None`: no clip |
    | `max_speed_2` | `None` | rad/s | clip on the second joint's speed; `None`: no clip |
    | `start` | `"bent"` | | start distribution |
    | `contact` | `"compliant"` | | there are no stops |
    | `render_mode` | `None` | | `"rgb_array"` or `"human"` |
    | `actuator` | `"position"` | | `position`: actions are targets of servos; `effort`: torques |
    | `servo_stiffness` | 60.0 | N m/rad | k_p of both servos |
    | `servo_damping` | 4.0 | N m s/rad | k_d of both servos |
    | `servo` | `"continuous"` | | when they are computed: `continuous`, `step`, or `period` |
    | `servo_period` | `None` | s | of `period`: time between two computations |
    | `target_limit` | π | rad | targets are within ±`target_limit` |
    | `max_torque` | 10.0 | N m | limit of the torque at either joint |
    | `marker_period` | 2.0 | s | of the fastest marker's way round |
    | `mass_1` | 1.0 | kg | mass of the first link |
    | `mass_2` | 1.0 | kg | mass of the second link |
    | `length_1` | 0.5 | m | first joint to second joint |
    | `length_2` | 0.5 | m | second joint to the tip |
    | `centre_1` | 0.25 | m | first joint to the first link's centre of mass |
    | `centre_2` | 0.25 | m | second joint to the second link's centre of mass |
    | `inertia_1` | 0.0208 | kg m^2 | of the first link about its centre of mass |
    | `inertia_2` | 0.0208 | kg m^2 | of the second link about its centre of mass |
    | `gravity` | 0.0 | m/s^2 | gravitational acceleration, along −z |
    | `damping` | 0.0 | N m s/rad | viscous damping at either joint |

    ## Info

    The same keys after every reset and step; energies in J over the control period.

    | Key | Unit | Meaning |
    |---|---|---|
    | `time` | s | since the start of the episode |
    | `energy` | J | kinetic + potential of the arm; zero at rest |
    | `actuator_work` | J | of the servos on the arm: integrated with the motion, or of `step` and `period` torque × displacement |
    | `dissipated` | J | taken out by damping, integrated with the motion |
    | `contact_loss` | J | 0: there are no stops |
    | `clip_loss` | J | taken out by speed limits |
    | `energy_residual` | J | ΔE − work + dissipated + contact_loss + clip_loss: what numerical error put in or took out |
    | `theta_1_target_applied`, `theta_2_target_applied` | rad | targets in force at the end of the period |
    | `theta_1_target_commanded`, `theta_2_target_commanded` | rad | asked for by this decision, after saturation and fallback |
    | `theta_1_effort`, `theta_2_effort` | N m | torques of the servos at the end of the period |
    | `saturated` | | whether an entry of the action was at a bound or beyond, or a torque at its limit at the end of the period |
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

    task_name = "reacher_follow"
    defaults: ClassVar = {
        "integrator": "rk4",
        "dt": 0.01,
        "actuator": "position",
        "servo_stiffness": 60.0,
        "servo_damping": 4.0,
        "length_1": 0.5,
        "length_2": 0.5,
        "centre_1": 0.25,
        "centre_2": 0.25,
        "inertia_1": 0.0208,
        "inertia_2": 0.0208,
    }


class IntegReacherVectorEnv(IntegVectorEnv, VectorEnv[Any, Any, Any]):
    """Vector form of :class:`IntegReacherEnv`; see :class:`IntegVectorEnv` for its arguments."""

    env_class = IntegReacherEnv
