"""``IntegQuadrotor-v0``: a planar quadrotor hovers."""

from __future__ import annotations

from typing import Any, ClassVar

from gymnasium import Env
from gymnasium.vector import VectorEnv

from ..environment import IntegEnv
from ..vector import IntegVectorEnv


class IntegQuadrotorEnv(IntegEnv, Env[Any, Any]):
    """Fly a thrown quadrotor to the middle of a room and hover there, under a chosen discretization.

    ```python
    >>> import gymnasium as gym, integ_gym
    >>> env = gym.make("IntegQuadrotor-v0", integrator="rk4", dt=0.01, control_period=0.02)
    >>> observation, info = env.reset(seed=0)
    >>> observation, reward, terminated, truncated, info = env.step([3.3, 3.1])
    >>> info["left_thrust_commanded"], info["right_thrust_commanded"]
    (3.3, 3.1)

    ```

    ## Description

    The plant is :class:`integ_gym.envs.plants.quadrotor.Quadrotor`: a rigid body in a vertical plane
    that two rotors carry. The thrusts follow the commanded ones with a lag of 0.05 s. Level flight
    takes 3.19 N of each rotor, and both together give up to 1.88 times the weight. Without control
    it falls out of the room within a second. Rates of the open loop are 0.15 1/s (drag) and 20 1/s
    (lag), so that explicit Euler and symplectic Euler take the lag wrong by 20 dt / 2 and are
    unstable from a step of 0.1 s; RK4 is from 0.139 s; the implicit integrators never are.

    The target is the room's middle in every episode; a start elsewhere is the same as a target
    elsewhere.

    With `way_point_period` the targets are way-points, the corners of a square of ±0.5 m about the
    room's middle, in turn and against the clock. A task sees nothing but the state of the plant, so
    that the guide's clock is a part of it, as the reacher's marker is: the state has its phase and
    rate at its end (:class:`integ_gym.envs.plants.quadrotor.GuidedQuadrotor`), and the way-point is
    the corner of the quadrant that the phase is in. Starts are at any phase. Observation and reward
    are those below with x and z seen from the way-point, so that policies of the one task fly the
    other. Success: within 0.1 m of the way-point and |θ| < 0.2 rad (wrapped) throughout the second
    half of each way-point's time, in the last two times. Give a `duration` of
    three of them, so that one is left for the start; the hand-made controller flies them at 4 s each.

    | Contract | |
    |---|---|
    | State | (x, ẋ, z, ż, θ, θ̇, impulse and thrust of the left rotor, of the right one), `env.unwrapped.state`; start from one with `reset(options={"state": …})` |
    | Observation | float32 (x, ẋ, z, ż, cos θ, sin θ, θ̇, left and right thrust) of the last sensor sample |
    | Action | `Box` (2,): commanded thrust of the left and of the right rotor, saturated to [0, `max_thrust`]; the saturation is counted |
    | Rates | physics every `dt`, decisions every `control_period`, commands held in between (zero-order hold), samples every `sensor_period` |
    | Frame | target; x to the right, z upwards, θ = 0 level, positive towards +x |
    | Units | SI: m, m/s, rad, rad/s, N, N s, kg, s, J |
    | Uncertainty | start distribution; Gaussian `observation_noise` on each sample of every component; when commands arrive, under `latency_jitter` and `hold_probability` |
    | Fallback | `hold` or `zero`, before the first command arrives and on non-finite actions; counted |
    | Metric | success: within 0.1 m of the target and |θ| < 0.2 rad (wrapped) throughout the last 2 s; return in physical time |
    | Likeliest failure | an integrator or a step that makes the lag shorter or longer than it is, so that a tight loop oscillates |

    ## Action Space

    `Box(0, max_thrust, (2,), float32)`, N; cast to float64 before the physics.

    ## Observation Space

    `Box`, float32: x and z unbounded, cosine and sine in ±1, the others within ±`max_speed`
    (unbounded without one), which limits the thrusts, too.

    ## Rewards

    At most 1 per 0.02 s, proportional to `control_period`, of the state at the start of the control
    period and the mean over the period of the squared thrusts commanded (under `action_latency` those
    of earlier decisions): (1 − 0.1 E) / (1 + D / (0.5 m)² + A) with
    E = (u_l² + u_r²) / (2 `max_thrust`²), D = x² + z² + (0.3 s)² (ẋ² + ż²) and
    A = 2 (1 − cos θ) + (0.3 s)² θ̇².

    ## Starting State

    `start="thrown"`: x and z uniform in ±1.5 m, θ in ±0.5 rad, ẋ and ż in ±1 m/s, θ̇ in ±1 rad/s,
    rotors idle. `reset(options={"throw": …})` gives another largest speed.

    ## Episode End

    Truncation after `duration`. Termination outside the room, |x| > 3 m or |z| > 3 m, after which
    nothing is paid; no reward is negative, so that leaving never pays. Divergence (a component that is
    not finite in float32, or a speed above 1000 m/s) ends the episode, too: the last good state is
    observed, and the reward is 0.

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
    | `duration` | 10.0 | s | truncation after ceil(duration / control_period) decisions |
    | `action_latency` | 0.0 | s | delay of every command, a whole multiple of `dt` |
    | `latency_jitter` | 0.0 | s | largest further delay of a command, drawn for each, a whole multiple of `dt` |
    | `hold_probability` | 0.0 | 1 | probability that a command does not arrive, drawn for each: the one before it holds |
    | `observation_latency` | 0.0 | s | age of every sample that is shown, a whole multiple of `dt` |
    | `sensor_period` | `None` | s | time between two samples, a whole multiple of `dt`; `None`: one per decision |
    | `observation_noise` | 0.0 | SI | standard deviation of each sensed state component |
    | `fallback` | `"hold"` | | `hold` the last control or `zero`, where no valid command acts |
    | `max_speed` | `None` | rad/s, m/s | clip on every velocity; `None`: no clip |
    | `start` | `"thrown"` | | start distribution: `thrown` |
    | `contact` | `"compliant"` | | there are no stops |
    | `render_mode` | `None` | | `"rgb_array"` or `"human"` |
    | `mass` | 0.65 | kg | mass of the body with its rotors |
    | `arm` | 0.23 | m | rotor to centre of mass |
    | `inertia` | 0.0075 | kg m^2 | moment of inertia in pitch |
    | `gravity` | 9.81 | m/s^2 | gravitational acceleration |
    | `damping` | 0.1 | N s/m | linear drag of the body |
    | `motor_time_constant` | 0.05 | s | lag of the thrusts; `None`: they act at once |
    | `max_thrust` | 6.0 | N | largest thrust of each rotor |
    | `way_point_period` | `None` | s | time for each way-point, half of it to fly there; `None`: hover |

    ## Info

    The same keys after every reset and step; energies in J over the control period.

    | Key | Unit | Meaning |
    |---|---|---|
    | `time` | s | since the start of the episode |
    | `energy` | J | kinetic + potential of the body; zero at rest at the target |
    | `actuator_work` | J | of the thrusts on the body, integrated with the motion |
    | `dissipated` | J | taken out by drag, integrated with the motion |
    | `contact_loss` | J | 0: there are no stops |
    | `clip_loss` | J | taken out by `max_speed` |
    | `energy_residual` | J | ΔE − work + dissipated + contact_loss + clip_loss: what numerical error put in or took out |
    | `left_thrust_applied`, `right_thrust_applied` | N | commanded thrusts in force at the end of the period |
    | `left_thrust_commanded`, `right_thrust_commanded` | N | asked for by this decision, after saturation and fallback |
    | `saturated` | | whether an entry of the action was at a bound or beyond |
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

    task_name = "quadrotor_hover"
    other_tasks: ClassVar = {"way_point_period": "quadrotor_way_points"}
    defaults: ClassVar = {"integrator": "rk4", "dt": 0.02}


class IntegQuadrotorVectorEnv(IntegVectorEnv, VectorEnv[Any, Any, Any]):
    """Vector form of :class:`IntegQuadrotorEnv`; see :class:`IntegVectorEnv` for its arguments."""

    env_class = IntegQuadrotorEnv
