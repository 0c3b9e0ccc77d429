"""``IntegHopper-v0``: a planar hopper hops forward at a commanded speed."""

from __future__ import annotations

from typing import Any, ClassVar

from gymnasium import Env
from gymnasium.vector import VectorEnv

from ..environment import IntegEnv
from ..vector import IntegVectorEnv


class IntegHopperEnv(IntegEnv, Env[Any, Any]):
    """Hop forward on one springy leg at a commanded speed, under a chosen discretization.

    ```python
    >>> import gymnasium as gym, integ_gym
    >>> env = gym.make("IntegHopper-v0", integrator="rk4", dt=0.002, control_period=0.02)
    >>> observation, info = env.reset(seed=0)
    >>> for _ in range(10):
    ...     observation, reward, terminated, truncated, info = env.step([0.0, 0.0])
    >>> info["foot_normal_force"] > 0.0, info["hip_torque_commanded"], info["leg_force_commanded"]
    (True, 0.0, 0.0)

    ```

    ## Description

    The plant is :class:`integ_gym.envs.plants.hopper.Hopper`: a torso on a leg of spring, damper and
    thrust, whose foot may touch the ground, and slide on it. Without control it bounces once or twice
    and falls over. On the ground the torso swings on the leg at 16 rad/s, the foot in the air at
    65 rad/s and on the ground at 210 rad/s, and friction brakes a foot that bears the weight at up to
    1300 1/s: where dt is the integration step, what happens at touch-down is only right where 210 dt
    is well below 1, and explicit integrators rattle the standing foot from a step of about 2 ms. RK4
    blows up at 10 ms and symplectic Euler at 5 ms; the implicit integrators do not, but implicit Euler
    drains what it does not resolve.

    | Contract | |
    |---|---|
    | State | (x, ẋ, z, ż, θ, θ̇, hip angle and its speed, leg length and its speed), `env.unwrapped.state`; start from one with `reset(options={"state": …})` |
    | Observation | float32, all of the state but x, ẋ first, of the last sensor sample |
    | Action | `Box` (2,): torque of the hip, N m, and force along the leg, N, saturated to ±`max_torque` and ±`max_force`; the saturation is counted. With `actuator="position"` they are targets of servos of hip and leg, within ±`target_limit`; see *Position servos* in docs/reference/environments.md |
    | Rates | physics every `dt`, decisions every `control_period`, controls held in between (zero-order hold), samples every `sensor_period` |
    | Frame | the ground, z = 0; x to the right, z upwards, θ = 0 upright, positive towards +x; hip = 0 along the torso, positive with the foot towards +x |
    | Units | SI: m, m/s, rad, rad/s, N, N m, kg, s, J |
    | Uncertainty | start distribution; Gaussian `observation_noise` on each sample of every component; when commands arrive, under `latency_jitter` and `hold_probability` |
    | Fallback | `hold` or `zero`, before the first command arrives and on non-finite actions; counted |
    | Metric | success: x > 5 s · `target_speed`, |θ| < 0.3 rad and ẋ within 0.4 m/s of `target_speed` throughout the last 2 s; return in physical time |
    | Likeliest failure | a step that does not resolve the touch of the foot, which then gains or loses speed at every hop |

    ## Action Space

    `Box` (2,), float32: ±`max_torque` in N m and ±`max_force` in N; cast to float64 before the physics.

    ## Observation Space

    `Box`, float32: (ẋ, z, ż, θ, θ̇, hip, its speed, leg, its speed), speeds within ±`max_speed`
    (unbounded without one), the others unbounded.

    ## Rewards

    At most 1 per 0.02 s, proportional to `control_period`, of the state at the start of the control
    period and the mean over the period of the squared controls in force (under `action_latency` those
    of earlier decisions): (1 − 0.1 E) / (1 + ((ẋ − `target_speed`) / 0.4 m/s)² + (θ / 0.3 rad)²) with
    E = (τ² / `max_torque`² + u² / `max_force`²) / 2.

    ## Starting State

    `start="dropped"`: x = 0, z uniform in 0.55 to 0.65 m, ẋ in 0 to 1 m/s, θ and the hip in ±0.1 rad,
    θ̇ in ±0.3 rad/s, a leg of 0.5 m at rest.

    ## Episode End

    Truncation after `duration`. Termination at a fall, z < 0.3 m or |θ| > 1 rad, after which nothing
    is paid; no reward is negative, so that falling never pays. Divergence (a component that is not
    finite in float32, or a speed above 1000 m/s) ends the episode, too: the last good state is
    observed, and the reward is 0.

    ## Arguments

    Keyword arguments of `gym.make`; all are JSON-serialisable. Plant parameters of `make_vec` may
    be arrays with one value per environment.

    | Name | Default | Unit | Meaning |
    |---|---|---|---|
    | `integrator` | `"implicit_midpoint"` | | one-step map such as `rk4`, as the engine calls it, or `module:Class` |
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
    | `max_speed` | `None` | rad/s, m/s | clip on every velocity; `None`: no clip |
    | `start` | `"dropped"` | | start distribution: `dropped` |
    | `contact` | `"compliant"` | | law of the foot on the ground: ours, the same in every engine |
    | `render_mode` | `None` | | `"rgb_array"` or `"human"` |
    | `actuator` | `"effort"` | | `effort`: actions are a torque and a force; `position`: they are targets of servos, whose arguments are in *Position servos* |
    | `mass` | 8.0 | kg | mass of the torso |
    | `inertia` | 1.0 | kg m^2 | of the torso in pitch, about the hip |
    | `foot_mass` | 0.5 | kg | mass of the foot |
    | `leg_length` | 0.5 | m | hip to foot where the spring is slack |
    | `leg_stiffness` | 2000.0 | N/m | of the leg's spring |
    | `damping` | 20.0 | N s/m | along the leg |
    | `gravity` | 9.81 | m/s^2 | gravitational acceleration |
    | `ground_stiffness` | 20000.0 | N/m | of the ground under the foot |
    | `ground_damping` | 0.5 | s/m | of the ground, see `press` |
    | `ground_friction` | 0.8 | 1 | coefficient of friction |
    | `friction_speed` | 0.1 | m/s | over which friction changes sign |
    | `target_speed` | 1.0 | m/s | commanded forward speed |
    | `max_torque` | 20.0 | N m | limit of the hip's torque |
    | `max_force` | 150.0 | N | limit of the force along the leg |

    ## Info

    The same keys after every reset and step; energies in J over the control period.

    | Key | Unit | Meaning |
    |---|---|---|
    | `time` | s | since the start of the episode |
    | `energy` | J | kinetic, of height above the ground and of the springs of leg and ground |
    | `actuator_work` | J | of both controls: their force times the way of what they drive, exact |
    | `dissipated` | J | taken out by the leg's damper, integrated with the motion |
    | `contact_loss` | J | taken out by the ground's damping and by friction, integrated with the motion |
    | `slip_loss` | J | of that, what friction took |
    | `clip_loss` | J | taken out by `max_speed` |
    | `energy_residual` | J | ΔE − work + dissipated + contact_loss + clip_loss: what numerical error put in or took out |
    | `hip_torque_applied`, `leg_force_applied` | N m, N | controls in force at the end of the period |
    | `hip_torque_commanded`, `leg_force_commanded` | N m, N | asked for by this decision, after saturation and fallback |
    | `saturated` | | whether an entry of the action was at a bound or beyond |
    | `fallback_used` | | whether the fallback acted in this period |
    | `sensor_time` | s | when the observed sample was taken |
    | `foot_penetration`, `penetration` | m | deepest of the foot at the end of any sub-step |
    | `foot_normal_force`, `foot_tangential_force` | N | on the foot at the end of the period |
    | `foot_slip_speed` | m/s | of the foot along the ground then; 0 in the air |
    | `foot_stored_energy` | J | of `energy`, what the ground under the foot has stored then |
    | `foot_contact_loss`, `foot_slip_loss` | J | of `contact_loss` and `slip_loss`, what was lost at the foot: all of it |
    | `contact_force` | N | largest normal force at the end of any sub-step |
    | `goal_since` | s | since when the state has been at the goal; −1 while it is not |
    | `success` | | true at the end of an episode that succeeded |
    | `solver_iterations` | | most iterations of any sub-step |
    | `solver_residual` | | largest scaled residual of any sub-step |
    | `solver_status` | | `ok`, `not_converged`, `diverged`, or `not_reported` by an engine that does not tell |

    ## Version History

    * v0: initial version.
    """

    task_name = "hopper_run"
    defaults: ClassVar = {"integrator": "implicit_midpoint", "dt": 0.01}


class IntegHopperVectorEnv(IntegVectorEnv, VectorEnv[Any, Any, Any]):
    """Vector form of :class:`IntegHopperEnv`; see :class:`IntegVectorEnv` for its arguments."""

    env_class = IntegHopperEnv
