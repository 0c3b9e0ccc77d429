"""``integ-gym panel``: run a panel and write its directory."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from integ_gym.eval.panel.conclusions import verdict_reason
from integ_gym.eval.panel.plan import with_seed_count
from integ_gym.eval.panel.run import run_panel
from integ_gym.eval.panel.spec import BUILT_IN, TRAINERS, PanelSpec, read_spec
from integ_gym.eval.report.forests import ordered_verdicts
from integ_gym.evidence.sealing import check_key, read_seal, sign
from integ_gym.support import options
from integ_gym.support.errors import InputError
from integ_gym.support.storage import is_remote
from integ_gym.support.terminal import hanging_indent, print_wrapped, true_minus, width_of

from . import printed
from .work_options import add_engine, add_work, page_location, resources_of, workers_of

EXAMPLES = """\
examples:
  integ-gym panel --out runs/panel        the built-in quick panel
  integ-gym panel --out runs/panel        again: finishes what was interrupted
  integ-gym panel --trainer sb3 --out runs/sb3
                                          by stable-baselines3, one by one
  integ-gym panel --memory-gib 4 --workers 8 --out runs/panel
                                          8 processes, 4 GiB together
  integ-gym panel --seeds 80 --out runs/panel
                                          keeps its seeds and adds others
  integ-gym panel --executor ray --address ray://head:10001 --out /shared/panel
                                          on a cluster
  integ-gym panel --executor slurm --workers 64 --out s3://bucket/panel
                                          64 Slurm jobs, in an object store
  integ-gym panel --power                 what its seeds can show; nothing runs
  integ-gym panel --plan                  what it costs; nothing runs
  integ-gym panel engines --out runs/engines
                                          the same policies on every engine
  integ-gym panel engines --policies runs/panel --out runs/engines
                                          without training them again
  integ-gym panel specs/cart_pole_balance.toml --out runs/balance
                                          a panel of your own

docs/how-to/clusters.md is about clusters, docs/reference/panel.md about panels.
"""


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    arguments = options.CommandParser(
        prog="integ-gym panel",
        description="Train policies on several discretizations, evaluate each on all of them and "
        "on the truth (the integrator `reference`), and write panel.json, report.html, figures "
        "and one evidence record per episode. Run it again to finish what was interrupted.",
        epilog=EXAMPLES,
    )
    names = ", ".join(BUILT_IN)
    add = arguments.add_argument
    add("spec", nargs="?", help=f"TOML file, or a built-in panel ({names}); default: quick")
    add(
        "--out", type=options.run_place, metavar="DIR",
        help="the panel's directory, or s3://…, gs://… or az://…, see docs/how-to/clusters.md",
    )  # fmt: skip
    add(
        "--power", action="store_true",
        help="run nothing: say what the seeds can show and, if --out is a finished panel, how many "
        "more each verdict needs",
    )  # fmt: skip
    add(
        "--plan", action="store_true",
        help="run nothing: say what the panel costs in core time and storage, and what the same "
        "would with 10, 1000 and 100,000 policies",
    )  # fmt: skip
    add(
        "--trainer", choices=TRAINERS,
        help="the compiled fleet trainer, or stable-baselines3; default: the specification's, "
        f"or else {PanelSpec.trainer}",
    )  # fmt: skip
    add(
        "--memory-gib", type=float, metavar="GIB",
        help="memory that the fleet's worker processes may take together, beside about 0.5 GiB of "
        "the command itself; default: the specification's, or else what "
        "docs/how-to/fleet.md says",
    )  # fmt: skip
    add(
        "--policies", type=Path, metavar="DIR",
        help="use the policies of this finished panel, which was trained with the same settings, "
        "instead of training",
    )  # fmt: skip
    add(
        "--seeds", type=options.whole_number, metavar="N",
        help="train the first N seeds of the specification, or all of them and the integers that "
        "follow; a finished directory keeps what it has",
    )  # fmt: skip
    add(
        "--sign", type=Path, metavar="KEY",
        help="sign the seal with this private key through ssh-keygen",
    )  # fmt: skip
    add_work(arguments)
    add_engine(arguments)
    add(
        "--verbose",
        action="store_true",
        help="also print the answer and the reason of every verdict",
    )
    return arguments


def main(argv: Sequence[str]) -> int:
    """Run the command; returns its exit code."""
    known = parser()
    arguments = known.parse_args(argv)
    used: tuple[str, ...]
    if arguments.power:
        used = ("power", "spec", "out", "seeds")
        options.refuse_unused(
            known, arguments, "--power says what seeds can show and runs nothing", used
        )
    elif arguments.plan:
        used = ("plan", "spec", "trainer", "memory_gib", "seeds", "policies", "workers")
        options.refuse_unused(
            known, arguments, "--plan says what a panel costs and runs nothing", used
        )
    spec = read_spec(arguments.spec or BUILT_IN[0])
    words = ["integ-gym", "panel", *([arguments.spec] if arguments.spec else [])]
    if arguments.trainer:
        spec = replace(spec, trainer=arguments.trainer)
        words += ["--trainer", arguments.trainer]
    if arguments.memory_gib is not None:
        if not 0.0 < arguments.memory_gib < math.inf:
            raise InputError(
                f"--memory-gib must be a finite number above 0, got {arguments.memory_gib}"
            )
        if spec.trainer != "fleet" or arguments.policies:
            raise InputError(
                "--memory-gib is for training with the fleet, which does not train here; omit it"
            )
        spec = replace(spec, memory_gib=arguments.memory_gib)
    if arguments.seeds is not None:
        spec = with_seed_count(spec, arguments.seeds)
        words += ["--seeds", str(arguments.seeds)]
    if arguments.policies:
        words += ["--policies", str(arguments.policies)]
    if arguments.power:
        if is_remote(arguments.out):
            raise InputError(
                f"--power reads a panel on this machine, and {arguments.out} is not; give --out a "
                "copy of the run, or omit it"
            )
        printed.print_power(spec, arguments.out)
        return 0
    if spec.unmade:
        print_wrapped(" ".join(spec.unmade), sys.stderr)
    if arguments.plan:
        printed.print_plan(spec, workers_of(arguments), trains=arguments.policies is None)
        return 0
    if arguments.out is None:
        raise InputError("a panel needs a directory: --out DIR")
    if arguments.sign is not None and is_remote(arguments.out):
        raise InputError(
            f"--sign signs a run on this machine, and {arguments.out} is not; when it is finished, "
            "sign a copy with `integ-gym evidence seal --sign`, and send seal.json.sig back"
        )
    if arguments.sign is not None:
        check_key(arguments.sign)
    command = options.display_command([*words, "--out", str(arguments.out)])
    panel = run_panel(
        spec,
        arguments.out,
        workers=workers_of(arguments),
        progress=not arguments.no_progress,
        policies=arguments.policies,
        command=command,
        executor=arguments.executor,
        address=arguments.address,
        resources=resources_of(arguments),
    )
    for doubt in panel.warnings:
        print_wrapped(true_minus(f"warning: {doubt}"), sys.stderr)
    printed.print_headline(panel)
    if panel.verdicts:
        printed.print_verdicts(panel, sys.stdout)
    if arguments.verbose or not panel.verdicts:
        printed.print_details(panel)
    if arguments.verbose:
        for verdict in ordered_verdicts(panel):
            name = f"  {verdict.verdict:<13}"
            place = f"{panel.label(verdict.row)} → {panel.label(verdict.cell)}"
            print(
                hanging_indent(
                    name, f"{place}: {verdict_reason(panel, verdict)}", width_of(sys.stdout)
                )
            )
    printed.print_next(panel)
    print(f"Page: {page_location(arguments.out)}")
    if is_remote(arguments.out):
        return 0
    sealed = read_seal(arguments.out)
    assert sealed is not None
    print(f"Seal: {sealed['seal']}")
    if arguments.sign is not None:
        print(f"Signed by {sign(arguments.out, arguments.sign)}")
    return 0
