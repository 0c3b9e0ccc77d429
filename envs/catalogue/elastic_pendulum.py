"""``IntegElasticPendulum-v0``: quieting of an elastic pendulum."""

from __future__ import annotations

from typing import Any, ClassVar

from gymnasium import Env
from gymnasium.vector import VectorEnv

from ..environment import IntegEnv
from ..vector import IntegVectorEnv


class IntegElasticPendulumEnv(IntegEnv, Env[Any, Any]):
    """Bring the swinging bob of an elastic pendulum to rest, under a chosen discretization.

    ```python
    >>> import gymnasium as gym, integ_gym
    >>> env = gym.make("IntegElasticPendulum-v0", integrator="implicit_midpoint", dt=0.02)
    >>> observation, info = env.reset(seed=0)

    ```

    ## Description

    The plant is :class:`integ_gym.envs.plants.elastic_pendulum.ElasticPendulum`: a bob on a stiff
    spring, pushed sideways. It swings at about 3 rad/s and bounces at 32 rad/s. Nothing takes
    energy out but the control, so without control it swings for ever, except where the integrator
    drains it: there no skill is needed, and a success proves nothing. Beyond a step of 0.063 s
    symplectic Euler and Störmer-Verlet are unstable, beyond 0.089 s RK4 is; explicit Euler is at
    every step; the implicit integrators never are.

    | Contract | |
    |---|---|
    | State | (x, ẋ, y, ẏ), `env.unwrapped.state`; start from one with `reset(options={"state": …})` |
    | Observation | float32 (x, ẋ, y, ẏ) of the last sensor sample |
    | Action | `Box` (1,): horizontal force on the bob, saturated at ±`max_force`; the saturation is counted. With `actuator="position"` it is the target of a servo of x, within ±`target_limit`; see *Position servos* in docs/reference/environments.md |
    | Rates | physics every `dt`, decisions every `control_period`, force held in between (zero-order hold), samples every `sensor_period` |
    | Frame | place where the bob hangs at rest; x to the right, y upwards |
    | Units | SI: m, m/s, N, kg, s, J |
    | Uncertainty | start distribution; Gaussian `observation_noise` on each sample of every component; when commands arrive, under `latency_jitter` and `hold_probability` |
    | Fallback | `hold` or `zero`, before the first command arrives and on non-finite actions; counted |
    | Metric | success: |x| < 0.1 m throughout the last 2 s; return in physical time |
    | Likeliest failure | an integrator that drains or pumps energy does, or undoes, the policy's work |

    ## Action Space

    `Box(-max_force, max_force, (1,), float32)`, N; cast to float64 before the physics.

    ## Observation Space

    `Box`, float32: x and y unbounded, ẋ and ẏ within ±`max_speed` (unbounded without one).

    ## Rewards

    At most 1 per 0.02 s, proportional to `control_period`, of the state at the start of the control
    period and the mean over the period of the squared force applied (under `action_latency` that of
    earlier decisions): (1 − 0.1 (F / `max_force`)²) / (1 + (x / 0.1 m)² + (0.3 s · ẋ / 0.1 m)²).

    ## Starting State

    `start="pushed"`: at the resting place, ẋ uniform from 1.5 to 3 m/s, ẏ in ±0.3 m/s.
    `reset(options={"push": …})` gives another largest ẋ.

    ## Episode End

    Truncation after `duration`. Termination only by divergence (a component that is not finite in
    float32, or a speed above 1000 m/s): the last good state is observed, and the reward is 0.

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
    | `start` | `"pushed"` | | start distribution: `pushed` |
    | `contact` | `"compliant"` | | there are no stops |
    | `render_mode` | `None` | | `"rgb_array"` or `"human"` |
    | `actuator` | `"effort"` | | `effort`: actions are forces; `position`: they are targets of servos, whose arguments are in *Position servos* |
    | `mass` | 1.0 | kg | mass of the bob |
    | `length` | 1.0 | m | length of the unloaded spring |
    | `stiffness` | 1000.0 | N/m | stiffness of the spring |
    | `gravity` | 9.81 | m/s^2 | gravitational acceleration |
    | `damping` | 0.0 | N s/m | viscous damping of the bob |
    | `max_force` | 2.0 | N | limit of the horizontal force |

    ## Info

    The same keys after every reset and step; energies in J over the control period.

    | Key | Unit | Meaning |
    |---|---|---|
    | `time` | s | since the start of the episode |
    | `energy` | J | kinetic + potential; zero at rest hanging |
    | `actuator_work` | J | Σ over sub-steps of control × displacement, exact |
    | `dissipated` | J | taken out by damping, integrated with the motion |
    | `contact_loss` | J | 0: there are no stops |
    | `clip_loss` | J | taken out by `max_speed` |
    | `energy_residual` | J | ΔE − work + dissipated + contact_loss + clip_loss: what numerical error put in or took out |
    | `control` | N | in force at the end of the period |
    | `commanded` | N | asked for by this decision, after saturation and fallback |
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

    task_name = "elastic_pendulum_quiet"
    defaults: ClassVar = {"integrator": "rk4", "dt": 0.02}


class IntegElasticPendulumVectorEnv(IntegVectorEnv, VectorEnv[Any, Any, Any]):
    """Vector form of :class:`IntegElasticPendulumEnv`; see :class:`IntegVectorEnv` for its arguments."""

    env_class = IntegElasticPendulumEnv
