"""``integ-gym evaluate``: evaluate an existing policy over many discretizations."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from integ_gym.envs.environment import OTHER_TESTBEDS, is_integ_environment
from integ_gym.envs.registries import ENVIRONMENTS
from integ_gym.eval.panel.claims import parse_claim
from integ_gym.eval.panel.existing import evaluate
from integ_gym.support import options
from integ_gym.support.errors import InputError
from integ_gym.support.terminal import print_wrapped

from .printed import print_details, print_headline, print_next
from .work_options import add_engine, add_work, page_location, resources_of, workers_of

EXAMPLES = """\
examples:
  integ-gym evaluate policy.zip --env IntegPendulum-v0 --out runs/mine
  integ-gym evaluate policy.zip --env IntegPendulum-v0 --out runs/mine \\
      --integrator rk4 --integrator explicit_euler --dt 0.05 --dt 0.01
  integ-gym evaluate policy.zip --env IntegPendulum-v0 --out runs/mine \\
      --home integrator=explicit_euler,dt=0.05,control_period=0.05
  integ-gym evaluate policy.zip --env IntegCartPole-v0 --home stock \\
      --obs-stats vecnormalize.pkl --out runs/mine
  integ-gym evaluate policy.zip --env Hopper-v5 --home stock --out runs/hopper \\
      --integrator Euler --integrator RK4 --dt 0.002 --dt 0.001
  integ-gym evaluate policy.zip --env IntegPendulum-v0 --out runs/mine \\
      --at home --vary control_period=0.05,0.1 --vary action_latency=0,0.05 \\
      --fail-if "loss > 0.1"
  integ-gym evaluate go1/policy.onnx --env examples.robots.go1:Go1 \\
      --env-arg folder=go1 --home stock --vary solver.iterations=1,100 \\
      --out runs/go1
  integ-gym evaluate hf://sb3/ppo-Pendulum-v1 --env IntegPendulum-v0 \\
      --home stock --out runs/zoo \\
      --obs-stats hf://sb3/ppo-Pendulum-v1/vec_normalize.pkl
  integ-gym evaluate --policy my_module:my_function --env IntegPendulum-v0 \\
      --out runs/mine

The policy's home is what its side-car POLICY.json says, or what --home states.
Without either it is unknown, and nothing is compared with home. `--home stock`
is the environment as its library makes it: Gymnasium's own, or a task of
MuJoCo, dm_control, Brax, …, or a robot's file. A policy is judged at its home's
control period; `--home control_period=S` states that alone. A function takes
one observation and gives one action.
"""

SHOWN = 3
"""Exit code where the claim of --fail-if is shown."""


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    arguments = options.CommandParser(
        prog="integ-gym evaluate",
        description="Evaluate a policy on every integrator at several steps and on the truth, the "
        "integrator `reference`, which solves the plant to rounding; where there is none, at a "
        "limit. No pickled code of a file is executed.",
        epilog=EXAMPLES,
    )
    add = arguments.add_argument
    add(
        "file",
        type=options.file_or_hub,
        nargs="?",
        metavar="POLICY",
        help="file of a policy: a .zip of stable-baselines3, .safetensors, .onnx, a state dict, or "
        "a TorchScript program (with --own-code), here or as hf://USER/REPO[/FILE]; see "
        "docs/how-to/policies.md",
    )
    add(
        "--policy", metavar="MODULE:FUNCTION",
        help="a function of your own, from one observation to one action, in place of a file",
    )  # fmt: skip
    add(
        "--env", required=True, metavar="ID",
        help=f"{', '.join(ENVIRONMENTS)}, {OTHER_TESTBEDS}",
    )  # fmt: skip
    add("--out", required=True, type=options.run_place, metavar="DIR", help="where results go")
    add(
        "--integrator", action="append", default=[], metavar="NAME",
        help="evaluate on this one; may be repeated (default: all)",
    )  # fmt: skip
    add(
        "--dt", action="append", default=[], type=float, metavar="S",
        help="integration step, s; may be repeated (default: a step, its half and its quarter; "
        "that step is the control period, or a MuJoCo task's own)",
    )  # fmt: skip
    add(
        "--engine", action="append", default=[], metavar="NAME",
        help="evaluate on this engine, by its own names of integrators; may be repeated (default: "
        "the home's)",
    )  # fmt: skip
    options.add_named_values(arguments, "--env-arg", "environment argument")
    add(
        "--vary", action="append", default=[], type=options.listed_values, metavar="NAME=V,V",
        help="environment argument with the values that it takes; may be repeated: every "
        "combination is evaluated, in every discretization. packages=mujoco==3.1.0,mujoco==3.2.7 "
        "evaluates with these versions, in interpreters that uv makes",
    )  # fmt: skip
    add(
        "--at", action="append", default=[], choices=("home", "truth"),
        help="with --vary: vary at home or on the truth alone; may be repeated",
    )  # fmt: skip
    add(
        "--limit", action=argparse.BooleanOptionalAction,
        help="extrapolate a limit from the best integrator at 1/2, 1/4 and 1/8 of the home's step, "
        "and compare the policy with it (default: where there is no truth and these steps fit)",
    )  # fmt: skip
    add(
        "--spec", type=Path, metavar="FILE",
        help="a TOML file of cells, starts and limit in place of --engine, --integrator, --dt, "
        "--vary, --at and --limit; see docs/reference/panel.md",
    )  # fmt: skip
    add(
        "--fail-if", metavar="CLAIM",
        help='end with exit code 3 if a claim is shown, such as "loss > 0.1" (in the worst cell) '
        'or "success < 0.9 in rk4 dt=0.01" (in that one). A claim is about loss, success or '
        "return, and is shown if the whole interval fulfils it",
    )  # fmt: skip
    add(
        "--success-return", type=float, metavar="R",
        help="of a task of Gymnasium's: an episode succeeds if its return reaches R (default: if "
        "it is not terminated within the time limit)",
    )  # fmt: skip
    add(
        "--home", metavar="HOME",
        help="what it was trained on: integrator=…,dt=…,control_period=…, or stock for the "
        "environment as its library makes it, or unknown (default: what the side-car says, else "
        "unknown)",
    )  # fmt: skip
    add(
        "--obs-stats", type=options.file_or_hub, metavar="FILE",
        help="VecNormalize's statistics: vecnormalize.pkl, read without executing it, or JSON: "
        '{"mean": [...], "var": [...], "epsilon": 1e-8, "clip_obs": 10.0}',
    )  # fmt: skip
    add(
        "--own-code", action="store_true",
        help="load the classes that the side-car names as module:Class; run a TorchScript program",
    )  # fmt: skip
    add(
        "--episodes",
        type=options.whole_number,
        metavar="N",
        help="starts (default: 50, or those of --spec)",
    )
    add_work(arguments, "1: this one")
    add_engine(arguments)
    return arguments


def main(argv: Sequence[str]) -> int:
    """Run the command; returns its exit code."""
    given = parser().parse_args(argv)
    if (given.file is None) == (given.policy is None):
        raise InputError("give either a policy's file or --policy MODULE:FUNCTION")
    if given.policy is not None and given.own_code:
        raise InputError(
            "--own-code is for what a policy's file holds or names, and --policy has none; omit it"
        )
    if given.policy is not None and ":" not in given.policy:
        raise InputError(f"--policy must be MODULE:FUNCTION, got {given.policy!r}")
    if given.episodes is not None and given.episodes < 1:
        raise InputError(f"--episodes must be 1 or above, got {given.episodes}")
    if given.success_return is not None and is_integ_environment(given.env):
        raise InputError(
            f"--success-return is for Gymnasium's tasks: what success is in {given.env} is fixed, "
            "in SI units; leave it out"
        )
    arguments = options.by_name(given.env_arg, "--env-arg", {"success_return": "--success-return"})
    if given.success_return is not None:
        arguments["success_return"] = given.success_return
    claim = None if given.fail_if is None else parse_claim(given.fail_if)
    panel = evaluate(
        given.policy or given.file,
        given.env,
        given.out,
        integrators=given.integrator,
        dts=given.dt,
        engines=given.engine,
        episodes=given.episodes,
        spec=given.spec,
        varied=options.by_name(given.vary, "--vary", {}),
        at=given.at,
        limit=given.limit,
        environment=arguments,
        obs_stats=given.obs_stats,
        home=given.home,
        own_code=given.own_code,
        workers=workers_of(given),
        progress=not given.no_progress,
        on_cells=(lambda names: None) if claim is None else claim.check_cell,
        on_home=lambda line: print_wrapped(line, sys.stderr),
        command=options.display_command(["integ-gym", "evaluate", *argv]),
        executor=given.executor,
        address=given.address,
        resources=resources_of(given),
    )
    print_headline(panel)
    print_details(panel)
    print_next(panel)
    print(f"Page: {page_location(given.out)}")
    shown = None if claim is None else claim.find_support(panel)
    if shown is not None:
        print_wrapped(f"--fail-if: {shown}", sys.stderr)
        return SHOWN
    return 0
