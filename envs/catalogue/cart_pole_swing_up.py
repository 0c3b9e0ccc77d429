"""``IntegCartPoleSwingUp-v0``: cart-pole swing-up on a bounded track."""

from __future__ import annotations

from typing import Any, ClassVar

from gymnasium import Env
from gymnasium.vector import VectorEnv

from ..environment import IntegEnv
from ..vector import IntegVectorEnv


class IntegCartPoleSwingUpEnv(IntegEnv, Env[Any, Any]):
    """Swing the pole of a cart-pole up on a bounded track, under a chosen discretization.

    ```python
    >>> import gymnasium as gym, integ_gym
    >>> env = gym.make("IntegCartPoleSwingUp-v0", integrator="rk4", dt=0.01, control_period=0.02)
    >>> observation, info = env.reset(seed=0)

    ```

    ## Description

    The plant is :class:`integ_gym.envs.plants.cart_pole.CartPole`, that of `IntegCartPole-v0`, with
    compliant stops (:class:`integ_gym.envs.plants.contact.Stops`) at both ends of its track. The track is
    as long as the range in which `IntegCartPole-v0` balances. The force limit is that
    environment's force, 0.93 of the weight of cart and pole: a swing-up takes about 3 s of the 10,
    within the track, so that what fails is the controller or the discretization. The stops are
    buffers: a cart at 3 m/s presses them in by 5 cm and leaves at somewhat less than half of its
    speed, and RK4's step of 0.02 s follows that (step times contact frequency 0.85).

    | Contract | |
    |---|---|
    | State | (x, ẋ, θ, θ̇), `env.unwrapped.state`; start from one with `reset(options={"state": …})` |
    | Observation | float32 (x, ẋ, cos θ, sin θ, θ̇) of the last sensor sample |
    | Action | `Box` (1,): force, saturated at ±`max_force`; the saturation is counted. With `actuator="position"` it is the target of a servo of x, within ±`target_limit`; see *Position servos* in docs/reference/environments.md |
    | Rates | physics every `dt`, decisions every `control_period`, force held in between (zero-order hold), samples every `sensor_period` |
    | Frame | track; x = 0 at its middle, θ = 0 upright, positive towards +x, unwrapped |
    | Units | SI: m, m/s, rad, rad/s, N, kg, s, J |
    | Uncertainty | start distribution; Gaussian `observation_noise` on each sample of x, ẋ, θ and θ̇; when commands arrive, under `latency_jitter` and `hold_probability` |
    | Fallback | `hold` or `zero`, before the first command arrives and on non-finite actions; counted |
    | Metric | success: |wrapped θ| < 0.2 rad throughout the last 2 s with |x| ≤ `track_limit`; return in physical time |
    | Likeliest failure | a policy that leans on a stop whose rebound, at a coarse step, is the integrator's own |

    ## Action Space

    `Box(-max_force, max_force, (1,), float32)`, N; cast to float64 before the physics.

    ## Observation Space

    `Box`, float32: cos θ and sin θ within ±1, x unbounded because the stops give way, ẋ and θ̇
    within ±`max_speed` (unbounded without one).

    ## Rewards

    At most 1 per 0.02 s, proportional to `control_period`, of the state at the start of the control
    period and the mean over the period of the squared force applied (under `action_latency` that
    of earlier decisions): ½ (1 + cos θ) · (1 − ½ min(1, |x| / `track_limit`)²) · (1 − 0.1 (F / `max_force`)²).

    ## Starting State

    `start="hanging"`: every component uniform in ±0.05 around rest hanging in the middle of the
    track; `start="upright"`: around rest upright. `reset(options={"low": …, "high": …})` gives other
    bounds. A start drawn beyond a stop is placed at it.

    ## Episode End

    Truncation after `duration`. Touching a stop does not end the episode. Termination only by
    divergence (a component that is not finite in float32, or a speed above 1000 m/s or rad/s): the
    last good state is observed, and the reward is 0.

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
    | `start` | `"hanging"` | | start distribution: `hanging` or `upright` |
    | `contact` | `"compliant"` | | law of the stops: ours, the same in every engine, or `engine` |
    | `render_mode` | `None` | | `"rgb_array"` or `"human"` |
    | `actuator` | `"effort"` | | `effort`: actions are forces; `position`: they are targets of servos, whose arguments are in *Position servos* |
    | `cart_mass` | 1.0 | kg | mass of the cart |
    | `mass` | 0.1 | kg | mass of the pole |
    | `length` | 0.5 | m | hinge to centre of mass of the pole |
    | `gravity` | 9.8 | m/s^2 | gravitational acceleration |
    | `damping` | 0.0 | N m s/rad | viscous damping at the hinge |
    | `cart_damping` | 0.0 | N s/m | viscous damping of the cart |
    | `friction` | 0.0 | N m | dry friction at the hinge |
    | `cart_friction` | 0.0 | N | dry friction of the cart |
    | `friction_speed` | 0.01 | rad/s, m/s | speed over which friction changes its sign |
    | `track_limit` | 2.4 | m | stops at ±`track_limit` |
    | `stop_stiffness` | 2000.0 | N/m | stiffness of the stops |
    | `stop_damping` | 0.5 | s/m | damping of the stops |
    | `mass_distribution` | `"uniform"` | | `uniform` pole or `point` mass at its centre of mass |
    | `max_force` | 10.0 | N | force limit of the motor |

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
    | `control` | N | in force at the end of the period |
    | `commanded` | N | asked for by this decision, after saturation and fallback |
    | `saturated` | | whether the action was at a bound or beyond |
    | `fallback_used` | | whether the fallback acted in this period |
    | `sensor_time` | s | when the observed sample was taken |
    | `penetration` | m | deepest penetration of a stop at the end of any sub-step |
    | `contact_force` | N | force of the stops, that of largest magnitude at the end of any sub-step |
    | `stop_stored_energy` | J | of `energy`, what the stops have stored at the end of the period |
    | `stop_contact_loss` | J | of `contact_loss`, what the stops took: all of it |
    | `goal_since` | s | since when the state has been at the goal; −1 while it is not |
    | `success` | | true at the end of an episode that succeeded |
    | `solver_iterations` | | most iterations of any sub-step |
    | `solver_residual` | | largest scaled residual of any sub-step |
    | `solver_status` | | `ok`, `not_converged`, `diverged`, or `not_reported` by an engine that does not tell |

    ## Version History

    * v0: initial version.
    """

    task_name = "cart_pole_swing_up"
    defaults: ClassVar = {"integrator": "rk4", "dt": 0.02, "track_limit": 2.4}


class IntegCartPoleSwingUpVectorEnv(IntegVectorEnv, VectorEnv[Any, Any, Any]):
    """Vector form of :class:`IntegCartPoleSwingUpEnv`; see :class:`IntegVectorEnv` for its arguments."""

    env_class = IntegCartPoleSwingUpEnv
