"""``IntegPendulum-v0``: torque-limited pendulum swing-up."""

from __future__ import annotations

from typing import Any, ClassVar

from gymnasium import Env
from gymnasium.vector import VectorEnv

from ..environment import IntegEnv
from ..vector import IntegVectorEnv


class IntegPendulumEnv(IntegEnv, Env[Any, Any]):
    """Swing a torque-limited pendulum up and keep it there, under a chosen discretization.

    ```python
    >>> import gymnasium as gym, integ_gym
    >>> env = gym.make("IntegPendulum-v0", integrator="rk4", dt=0.01, control_period=0.05)
    >>> observation, info = env.reset(seed=0)

    ```

    ## Description

    The plant is :class:`integ_gym.envs.plants.pendulum.Pendulum`. With the defaults the
    environment is Gymnasium's ``Pendulum-v1`` wherever |θ̇| ≤ 8 rad/s, and everywhere with
    ``max_speed=8.0``; by default there is no clip, because a clip is an artefact of its own.

    | Contract | |
    |---|---|
    | State | (θ, θ̇), `env.unwrapped.state`; start from one with `reset(options={"state": …})` |
    | Observation | float32 (cos θ, sin θ, θ̇) of the last sensor sample |
    | Action | `Box` (1,): torque, saturated at ±`max_torque`; the saturation is counted. With `actuator="position"` it is the target of a servo of θ, within ±`target_limit`; see *Position servos* in docs/reference/environments.md |
    | Rates | physics every `dt`, decisions every `control_period`, torque held in between (zero-order hold), samples every `sensor_period` |
    | Frame | hinge; θ = 0 upright, positive counter-clockwise, unwrapped |
    | Units | SI: rad, rad/s, N m, kg, m, s, J |
    | Uncertainty | start distribution; Gaussian `observation_noise` on each sample of θ and θ̇; when commands arrive, under `latency_jitter` and `hold_probability` |
    | Fallback | `hold` or `zero`, before the first command arrives and on non-finite actions; counted |
    | Metric | success: |wrapped θ| < 0.2 rad throughout the last 2 s; return in physical time |
    | Likeliest failure | a policy trained where the integrator pumps energy in lacks the torque elsewhere |

    ## Action Space

    `Box(-max_torque, max_torque, (1,), float32)`, N m; cast to float64 before the physics.

    ## Observation Space

    `Box`, float32: cos θ and sin θ within ±1, θ̇ within ±`max_speed` (unbounded without one).

    ## Rewards

    −(θ² + 0.1 θ̇² + 0.001 τ²) per 0.05 s, θ wrapped. θ and θ̇ are those at the start of the
    control period; τ² is the mean over the period of the squared torque in force, under
    `action_latency` that of earlier decisions. Proportional to `control_period`: at 0.05 s it is
    that of ``Pendulum-v1``, and returns compare across discretizations.

    ## Starting State

    `start="uniform"`: θ in ±π, θ̇ in ±1 rad/s, as in Gymnasium. `start="hanging"`: within ±0.2 rad
    and ±0.2 rad/s of the bottom. `reset(options={"x_init": …, "y_init": …})` gives other bounds.

    ## Episode End

    Truncation after `duration`. Termination only by divergence (a component that is not finite in
    float32, or a speed above 1000 rad/s): the last good state is observed, and the reward is the
    worst that the remaining time could have brought.

    ## Arguments

    Keyword arguments of `gym.make`; all are JSON-serialisable. Plant parameters of `make_vec` may
    be arrays with one value per environment.

    | Name | Default | Unit | Meaning |
    |---|---|---|---|
    | `integrator` | `"symplectic_euler"` | | one-step map such as `rk4`, as the engine calls it, or `module:Class` |
    | `dt` | 0.05 | s | integration step |
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
    | `start` | `"uniform"` | | start distribution: `uniform` or `hanging` |
    | `contact` | `"compliant"` | | law of the stops: ours, the same in every engine, or `engine` |
    | `render_mode` | `None` | | `"rgb_array"` or `"human"` |
    | `actuator` | `"effort"` | | `effort`: actions are torques; `position`: they are targets of servos, whose arguments are in *Position servos* |
    | `mass` | 1.0 | kg | mass of the rod or bob |
    | `length` | 1.0 | m | hinge to far end of the rod, or to the bob |
    | `gravity` | 10.0 | m/s^2 | gravitational acceleration |
    | `damping` | 0.0 | N m s/rad | viscous damping at the hinge |
    | `friction` | 0.0 | N m | dry friction at the hinge |
    | `friction_speed` | 0.01 | rad/s | speed over which friction changes its sign |
    | `joint_limit` | `None` | rad | stops at ±`joint_limit` from upright, turns counted; `None`: no stops |
    | `stop_stiffness` | 200.0 | N m/rad | stiffness of the stops |
    | `stop_damping` | 0.1 | s/rad | damping of the stops |
    | `mass_distribution` | `"uniform"` | | `uniform` rod or `point` mass at the end |
    | `max_torque` | 2.0 | N m | torque limit of the motor |

    ## Info

    The same keys after every reset and step; energies in J over the control period.

    | Key | Unit | Meaning |
    |---|---|---|
    | `time` | s | since the start of the episode |
    | `energy` | J | kinetic + potential, of stops too; zero at rest hanging |
    | `actuator_work` | J | Σ over sub-steps of control × displacement, exact |
    | `dissipated` | J | taken out by damping and friction, integrated with the motion |
    | `contact_loss` | J | taken out by the stops, integrated with the motion |
    | `clip_loss` | J | taken out by `max_speed` |
    | `energy_residual` | J | ΔE − work + dissipated + contact_loss + clip_loss: what numerical error put in or took out |
    | `control` | N m | in force at the end of the period |
    | `commanded` | N m | asked for by this decision, after saturation and fallback |
    | `saturated` | | whether the action was at a bound or beyond |
    | `fallback_used` | | whether the fallback acted in this period |
    | `sensor_time` | s | when the observed sample was taken |
    | `penetration` | rad | deepest penetration of a stop at the end of any sub-step |
    | `contact_force` | N m | force of the stops, that of largest magnitude at the end of any sub-step |
    | `stop_stored_energy` | J | of `energy`, what the stops have stored at the end of the period; where there are stops (`joint_limit`) |
    | `stop_contact_loss` | J | of `contact_loss`, what the stops took: all of it; where there are stops (`joint_limit`) |
    | `goal_since` | s | since when the state has been at the goal; −1 while it is not |
    | `success` | | true at the end of an episode that succeeded |
    | `solver_iterations` | | most iterations of any sub-step |
    | `solver_residual` | | largest scaled residual of any sub-step |
    | `solver_status` | | `ok`, `not_converged`, `diverged`, or `not_reported` by an engine that does not tell |

    ## Version History

    * v0: initial version.
    """

    task_name = "pendulum_swing_up"
    defaults: ClassVar = {"integrator": "symplectic_euler", "dt": 0.05}


class IntegPendulumVectorEnv(IntegVectorEnv, VectorEnv[Any, Any, Any]):
    """Vector form of :class:`IntegPendulumEnv`; see :class:`IntegVectorEnv` for its arguments."""

    env_class = IntegPendulumEnv
