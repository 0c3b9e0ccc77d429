"""The environments as pure functions of JAX arrays: for ``jit``, ``vmap`` and ``scan``.

    import jax
    from integ_gym.envs import functional

    env = functional.make("IntegPendulum-v0", integrator="rk4", dt=0.05)
    state = env.initial(jax.random.key(0), lanes=(1024,))
    state = jax.jit(env.transition)(state, actions, key)

The physics is that of the single and the vector environment. Plant and task parameters, steps,
horizon and start range are values, not structure: one compiled function serves all of them.
"""

from integ_gym.envs.functional.environment import FunctionalEnv
from integ_gym.envs.functional.making import make
from integ_gym.envs.functional.params import Params
from integ_gym.envs.functional.starts import start_range
from integ_gym.envs.functional.state import FuncState, TimeStep
from integ_gym.envs.functional.structure import Structure

__all__ = [
    "FuncState",
    "FunctionalEnv",
    "Params",
    "Structure",
    "TimeStep",
    "make",
    "start_range",
]
