"""``IntegCartPole-v0``: cart-pole balance."""

from __future__ import annotations

from typing import Any, ClassVar

from gymnasium import Env
from gymnasium.vector import VectorEnv

from ..environment import IntegEnv
from ..vector import IntegVectorEnv


class IntegCartPoleEnv(IntegEnv, Env[Any, Any]):
    """Keep the pole of a cart-pole upright, under a chosen discretization.

    ```python
    >>> import gymnasium as gym, integ_gym
    >>> env = gym.make("IntegCartPole-v0", integrator="rk4", dt=0.01, control_period=0.02)
    >>> observation, info = env.reset(seed=0)

    ```

    ## Description

    The plant is :class:`integ_gym.envs.plants.cart_pole.CartPole`. With the defaults the environment
    is Gymnasium's ``CartPole-v1``.

    | Contract | |
    |---|---|
    | State | (x, ẋ, θ, θ̇), `env.unwrapped.state`; start from one with `reset(options={"state": …})` |
    | Observation | float32 (x, ẋ, θ, θ̇) of the last sensor sample |
    | Action | `Discrete(2)`: force −`force_mag` or +`force_mag`; others raise |
    | Rates | physics every `dt`, decisions every `control_period`, force held in between (zero-order hold), samples every `sensor_period` |
    | Frame | track; x = 0 at its middle, θ = 0 upright, positive towards +x |
    | Units | SI: m, m/s, rad, rad/s, N, kg, s, J |
    | Uncertainty | start distribution; Gaussian `observation_noise` on each sample of every component; when commands arrive, under `latency_jitter` and `hold_probability` |
    | Fallback | `hold` or `zero` (0 N), before the first command arrives and on non-finite actions; counted |
    | Metric | success: not terminated within `duration`; return in physical time |
    | Likeliest failure | a coarse step hides or invents instability of the balancing loop |

    ## Action Space

    `Discrete(2)`: 0 pushes towards −x, 1 towards +x.

    ## Observation Space

    `Box`, float32: x within twice `x_threshold`, θ within twice `theta_threshold`, velocities
    unbounded (±`max_speed` with one).

    ## Rewards

    1 per 0.02 s, the terminating step included, proportional to `control_period`: at 0.02 s it is
    that of ``CartPole-v1``. With `sutton_barto_reward`, 0 per step and −1 at termination.

    ## Starting State

    Every component uniform in ±0.05; `reset(options={"low": …, "high": …})` gives other bounds.

    ## Episode End

    Termination beyond ±`x_threshold` or ±`theta_threshold`, checked at control instants, or by
    divergence (a component that is not finite in float32, or a speed above 1000 m/s or rad/s),
    whose reward is 0 (−1 with `sutton_barto_reward`). Truncation after `duration`.

    ## Arguments

    Keyword arguments of `gym.make`; all are JSON-serialisable. Plant parameters of `make_vec` may
    be arrays with one value per environment.

    | Name | Default | Unit | Meaning |
    |---|---|---|---|
    | `integrator` | `"explicit_euler"` | | one-step map such as `rk4`, as the engine calls it, or `module:Class` |
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
    | `start` | `"upright"` | | start distribution: `upright` |
    | `contact` | `"compliant"` | | law of the stops: ours, the same in every engine, or `engine` |
    | `render_mode` | `None` | | `"rgb_array"` or `"human"` |
    | `cart_mass` | 1.0 | kg | mass of the cart |
    | `mass` | 0.1 | kg | mass of the pole |
    | `length` | 0.5 | m | hinge to centre of mass of the pole |
    | `gravity` | 9.8 | m/s^2 | gravitational acceleration |
    | `damping` | 0.0 | N m s/rad | viscous damping at the hinge |
    | `cart_damping` | 0.0 | N s/m | viscous damping of the cart |
    | `friction` | 0.0 | N m | dry friction at the hinge |
    | `cart_friction` | 0.0 | N | dry friction of the cart |
    | `friction_speed` | 0.01 | rad/s, m/s | speed over which friction changes its sign |
    | `track_limit` | `None` | m | stops at ±`track_limit`; `None`: no stops |
    | `stop_stiffness` | 2000.0 | N/m | stiffness of the stops |
    | `stop_damping` | 0.5 | s/m | damping of the stops |
    | `mass_distribution` | `"uniform"` | | `uniform` pole or `point` mass at its centre of mass |
    | `force_mag` | 10.0 | N | magnitude of the force |
    | `x_threshold` | 2.4 | m | the episode ends beyond ±`x_threshold` |
    | `theta_threshold` | 0.2094 | rad | the episode ends beyond ±`theta_threshold` |
    | `sutton_barto_reward` | `False` | | 0 per step and −1 at termination instead |

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
    | `stop_stored_energy` | J | of `energy`, what the stops have stored at the end of the period; where there are stops (`track_limit`) |
    | `stop_contact_loss` | J | of `contact_loss`, what the stops took: all of it; where there are stops (`track_limit`) |
    | `goal_since` | s | since when the state has been at the goal; −1 while it is not |
    | `success` | | true at the end of an episode that succeeded |
    | `solver_iterations` | | most iterations of any sub-step |
    | `solver_residual` | | largest scaled residual of any sub-step |
    | `solver_status` | | `ok`, `not_converged`, `diverged`, or `not_reported` by an engine that does not tell |

    ## Version History

    * v0: initial version.
    """

    task_name = "cart_pole_balance"
    defaults: ClassVar = {"integrator": "explicit_euler", "dt": 0.02}


class IntegCartPoleVectorEnv(IntegVectorEnv, VectorEnv[Any, Any, Any]):
    """Vector form of :class:`IntegCartPoleEnv`; see :class:`IntegVectorEnv` for its arguments."""

    env_class = IntegCartPoleEnv
