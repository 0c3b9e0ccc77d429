"""The environments as pure functions of JAX arrays: for ``jit``, ``vmap`` and ``scan``.

    import jax
    from integ_gym.envs import functional

    env = functional.make("IntegPendulum-v0", integrator="rk4", dt=0.05)
    state = env.initial(jax.random.key(0), lanes=(1024,))
    state = jax.jit(env.transition)(state, actions, key)

The physics is that of the single and the vector environment. Plant and task parameters, steps,
horizon and start range are values, not structure: one compiled function serves all of them.
"""

from .environment import FunctionalEnv
from .making import make
from .params import Params
from .starts import start_range
from .state import FuncState, TimeStep
from .structure import Structure

__all__ = [
    "FuncState",
    "FunctionalEnv",
    "Params",
    "Structure",
    "TimeStep",
    "make",
    "start_range",
]
