"""The environments: plants, integrators and engines, and the tasks asked of them.

This floor knows the discrete map that a policy meets and how to step, draw and measure it. It knows
nothing of evidence, training or panels.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from . import numerics
    from .arithmetic import ARRAY, SCALAR, Component, Components, Ops, jax, jnp
    from .catalogue import (
        ENVIRONMENTS,
        OTHER_TESTBEDS,
        OWN_ENVIRONMENT,
        environment_class,
        environment_setup,
        is_integ_environment,
        register_environments,
    )
    from .engines import (
        CONSTRAINT_VIOLATION,
        ENGINES,
        Engine,
        NativeEngine,
        integrators_of,
        missing_modules,
    )
    from .environments import (
        ASSUMED_RATE,
        SURVIVAL,
        DiscretizedVectorEnv,
        FunctionalEnv,
        IntegEnv,
        IntegVectorEnv,
        Params,
        RediscretizedEnv,
        functional,
        rediscretize,
        time_limit,
    )
    from .episode import (
        DISCRETIZATION,
        LOSSES,
        NATIVE,
        STATUS_NAMES,
        WEIGHT,
        Discretization,
        EnvState,
        Mixture,
        Outcome,
        Script,
        Settings,
        Setup,
        Timing,
        agrees,
        check_divides,
        dividing_step,
        quiet_status,
        reset_info,
        script_of,
        step_info,
        whole_multiple,
    )
    from .integrators import INTEGRATORS, TRUTH, Integrator, LinearTheory, Step, along
    from .maps import map_names, one_step_map
    from .mechanics import PlantSystem
    from .plants import (
        PLANTS,
        CartPole,
        ElasticPendulum,
        Pendulum,
        Plant,
        join_state,
        split_state,
        state_names,
        state_units,
    )
    from .rendering import (
        SHOWN,
        Choice,
        Cockpit,
        Course,
        Moment,
        Pane,
        Panes,
        View,
        load_pygame,
        open_screen,
    )
    from .tasks import (
        FLOAT32_ROUNDING,
        NEAR_PLUMB,
        TASKS,
        BoxTask,
        CartPoleBalance,
        CartPoleSwingUp,
        Command,
        ElasticPendulumQuiet,
        PendulumSwingUp,
        Task,
        wrapped,
    )
    from .testbeds import (
        Applied,
        GymTestbed,
        Success,
        Testbed,
        make_checked,
        make_training_environments,
        testbed_of,
    )
else:
    __getattr__, __dir__ = lazy_door(__name__)
