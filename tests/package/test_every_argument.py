"""No argument of `evaluate`, `panel`, `train` and `watch` is neither applied nor refused.

Every option of a command and every parameter of the function behind it changes what is done; one
that is added is tried too, with a value that its type suggests. Combinations in which an argument
could not act are refused.
"""

from __future__ import annotations

import argparse
import inspect
from contextlib import contextmanager, suppress
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from house import ROOT

import integ_gym
from integ_gym.cli import main
from integ_gym.commands import evaluate, panel, train, watch
from integ_gym.eval import watch as of_policy
from integ_gym.eval.panel import existing
from integ_gym.eval.panel import run as calls
from integ_gym.eval.panel.claims import parse_claim
from integ_gym.eval.panel.spec import read_spec
from integ_gym.support.executors import Resources
from integ_gym.train import command as training

PENDULUM = "IntegPendulum-v0"
MODULES: dict[str, Any] = {"evaluate": evaluate, "panel": panel, "train": train, "watch": watch}


class Stopped(Exception):
    """Ends a command where its work would begin."""


def act(observation):
    return [0.0]


@pytest.fixture
def done(monkeypatch, tmp_path):
    """Runs a command up to its work, and tells what that would be."""
    calls_made: list[str] = []

    def note(name, stop=True, result=None):
        def called(*args, **kwargs):
            kwargs.pop("command", None)
            calls_made.append(f"{name} {args} {sorted(kwargs.items())}")
            if stop:
                raise Stopped
            return result

        return called

    told = SimpleNamespace(warnings=(), verdicts=(1,), said=str)
    monkeypatch.setattr(evaluate, "evaluate", note("evaluate"))
    monkeypatch.setattr(panel, "run_panel", note("run", stop=False, result=told))
    for name in ("plan", "power", "headline", "details", "next", "verdicts"):
        monkeypatch.setattr(panel.printed, f"print_{name}", note(name, stop=False))
    monkeypatch.setattr(panel, "ordered_verdicts", lambda told: ())
    monkeypatch.setattr(panel, "read_seal", lambda out: {"seal": "0"})
    monkeypatch.setattr(panel, "check_key", str)
    monkeypatch.setattr(panel, "sign", note("sign", stop=False, result="f"))
    for name in ("watch", "side_by_side"):
        monkeypatch.setattr(watch, name, note(name))
    monkeypatch.setattr(watch, "_list", note("list", stop=False, result=0))
    algorithms = {
        name: replace(algorithm, train=note(name))
        for name, algorithm in training.ALGORITHMS.items()
    }
    monkeypatch.setattr(training, "ALGORITHMS", algorithms)
    monkeypatch.setattr("integ_gym.train.fleet.training.train_fleet", note("fleet"))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "policy").mkdir()
    (tmp_path / "policy" / "policy.zip").touch()
    (tmp_path / "panel" / "evidence").mkdir(parents=True)

    def run(words):
        calls_made.clear()
        with suppress(Stopped):
            MODULES[words[0]].main(list(words[1:]))
        return list(calls_made)

    return run


EVALUATE = ("evaluate", "policy.zip", "--env", PENDULUM, "--out", "out")
HOPPER = ("evaluate", "policy.zip", "--env", "Hopper-v5", "--out", "out")
PANEL = ("panel", "--out", "out")
TRAIN = ("train", "--out", "out")
SAC = (*TRAIN, "--algorithm", "sac")
WATCH = ("watch", "policy")
STOPS = (*TRAIN, "--env", "IntegCartPoleSwingUp-v0", "--engine", "mujoco", "--integrator", "RK4")
BASES = {"evaluate": EVALUATE, "panel": PANEL, "train": TRAIN, "watch": WATCH}
WHOLE: dict[tuple[str, str], tuple[tuple[str, ...], tuple[str, ...]]] = {
    ("evaluate", "file"): (EVALUATE, ("evaluate", "other.zip", *EVALUATE[2:])),
    ("evaluate", "policy"): (EVALUATE, ("evaluate", "--policy", "a:b", *EVALUATE[2:])),
    ("evaluate", "vary"): (EVALUATE, (*EVALUATE, "--vary", "action_latency=0,0.05")),
    ("evaluate", "at"): (
        (*EVALUATE, "--vary", "mass=2"),
        (*EVALUATE, "--vary", "mass=2", "--at", "home"),
    ),
    ("evaluate", "fail_if"): (EVALUATE, (*EVALUATE, "--fail-if", "loss > 0.1")),
    ("evaluate", "success_return"): (HOPPER, (*HOPPER, "--success-return", "5")),
    ("panel", "spec"): (PANEL, (*PANEL, str(ROOT / "specs" / "cart_pole_swing_up.toml"))),
    ("panel", "plan"): (PANEL, ("panel", "--plan")),
    ("panel", "trainer"): (PANEL, (*PANEL, "--trainer", "sb3")),
    ("train", "engine"): (TRAIN, (*TRAIN, "--engine", "mujoco", "--integrator", "RK4")),
    ("train", "contact"): (STOPS, (*STOPS, "--contact", "engine")),
    ("watch", "run"): (WATCH, ("watch", "policy/policy.zip")),
    ("watch", "record"): (("watch", "panel"), ("watch", "panel", "3f9a")),
}
"""Words without an argument and with it, where more is to be said than an option and its value."""
VALUES = {
    "activation": "ReLU", "address": "ray://head:1", "algorithm": "sac", "batch_size": "128",
    "control_period": "0.2", "env": "IntegCartPole-v0", "env_arg": "mass=1.2",
    "env_id": "IntegCartPole-v0", "executor": "ray", "fallback": "zero", "home": "stock",
    "initial_entropy": "0.2", "integrator": "rk4", "max_speed": "8", "n_steps": "128", "on": "rk4",
    "reward_scale": "1", "sensor_period": "0.1", "start": "hanging", "total_steps": "8192",
}  # fmt: skip
"""What options are given that do not take whatever is of their type."""


def _other(action: argparse.Action) -> str:
    """A value of an option that is not its default."""
    if action.dest in VALUES:
        return VALUES[action.dest]
    if action.choices:
        return next(str(choice) for choice in action.choices if choice != action.default)
    return {"float": "0.1", "number": "0.1"}.get(getattr(action.type, "__name__", ""), "3")


def _cases():
    """Command, argument, and words without it and with it, of which another thing is done."""
    for name, module in MODULES.items():
        parsers = {BASES[name]: module.parser()}
        if name == "train":
            parsers[SAC] = module.parser(algorithm="sac")
        seen = {"help"} | ({"out"} if name == "watch" else set())  # of films, in test_watch.py
        for base, parser in parsers.items():
            for action in parser._actions:
                if action.dest not in seen:
                    seen.add(action.dest)
                    given = [_other(action)] if action.nargs != 0 else []
                    words = (*base, *action.option_strings[-1:], *given)
                    yield name, action.dest, *WHOLE.get((name, action.dest), (base, words))


CASES = list(_cases())


def test_every_case_is_of_an_option():
    assert {name for name, *_ in CASES} == set(MODULES)
    assert set(WHOLE) <= {(name, option) for name, option, *_ in CASES}


@pytest.mark.parametrize(
    ("without", "with_it"), [case[2:] for case in CASES], ids=[" ".join(c[:2]) for c in CASES]
)
def test_every_option_changes_what_is_done(without, with_it, done):
    before, after = done(without), done(with_it)
    assert before
    assert after
    assert before != after


SINE = ("evaluate", "--policy", "math:sin", *EVALUATE[2:])
REFUSED = [
    ((*SINE, "--env-arg", "dt=0.1"), "`dt` is what the evaluation varies"),
    ((*EVALUATE, "--env-arg", "success_return=1"), "give --success-return in place of"),
    ((*EVALUATE, "--env-arg", "mass=1", "--env-arg", "mass=2"), "says both mass=1 and 2; give one"),
    ((*EVALUATE, "--success-return", "5"), "--success-return is for Gymnasium's tasks"),
    ((*EVALUATE, "--policy", "a:b"), "give either a policy's file or --policy"),
    (("evaluate", "--policy", "a:b", *EVALUATE[2:], "--own-code"), "--policy has none; omit it"),
    (("evaluate", *EVALUATE[2:]), "give either a policy's file or --policy"),
    (("evaluate", "--policy", "mine.py", *EVALUATE[2:]), "--policy must be MODULE:FUNCTION, got"),
    ((*PANEL, "--trainer", "sb3", "--memory-gib", "4"), "which does not train here; omit it"),
    ((*PANEL, "--policies", "x", "--memory-gib", "4"), "which does not train here; omit it"),
    ((*PANEL, "--plan"), "--plan says what a panel costs and runs nothing, so --out has no effect"),
    ((*TRAIN, "--env-arg", "dt=0.1", "--dt", "0.1"), "give --dt in place of --env-arg dt"),
    ((*TRAIN, "--trainer", "fleet", "--algorithm", "sac"), "the fleet trains PPO"),
    ((*TRAIN, "--trainer", "fleet", "--env", "Acrobot-v1"), "with --trainer sb3"),
    ((*TRAIN, "--integrator", "rk4", "--env-arg", 'mixture=[{"integrator": "rk4", "dt": 0.1}]'),
     "has no effect"),
    (("watch", "panel", "3f9a", "--seed", "3"), "--seed is for a trained policy"),
    (("watch", "panel", "--own-code"), "is a run; give the id of one"),
    (("watch", "panel", "--on", "rk4"), "is a run; give the id of one"),
    (("diagnose", "--example", "drift", "--workers", "2"), "so --workers has no effect"),
    (("engines", "--engine", "mujco"), "'mujoco'"),
]  # fmt: skip


@pytest.mark.parametrize(("words", "fragment"), REFUSED)
def test_what_could_not_act_is_refused(words, fragment, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "panel" / "evidence").mkdir(parents=True)
    assert main(list(words)) == 2
    assert fragment in capsys.readouterr().err.replace("\n", " ")


@pytest.mark.parametrize(
    "option",
    [a for a in panel.parser()._actions if a.dest not in {"spec", "out", "power", "seeds", "help"}],
    ids=lambda a: a.dest,
)
def test_what_runs_nothing_refuses_what_is_for_a_run(option):
    given = [_other(option)] if option.nargs != 0 else []
    with pytest.raises(ValueError, match=f"so {option.option_strings[0]} has no effect; leave it"):
        panel.main(["--power", option.option_strings[0], *given])


@pytest.fixture
def judged(monkeypatch):
    """Calls `evaluate` up to its work, and tells what that would be."""

    def run(**given):
        found: list[Any] = []

        def evaluated(given_policy, spec, place, command, **options):
            policy, origin = given_policy.policy.policy_id, str(given_policy.provenance)
            workers = options.pop("cluster").workers
            found.append((policy, origin, given_policy.seed, spec.to_json(), str(place), command))
            found.append((workers, options))

        monkeypatch.setattr(existing, "evaluate_existing", evaluated)
        base = {"policy": act, "env_id": PENDULUM, "out": "out", "on_home": found.append}
        existing.evaluate(**{**base, **given})
        return repr(found)

    return run


@pytest.fixture
def panelled(monkeypatch, tmp_path):
    """Calls `run_panel` up to its work, and tells what that would be."""
    monkeypatch.chdir(tmp_path)

    def run(**given):
        found: list[Any] = []

        @contextmanager
        def opened(spec, place, cluster, policies, progress):
            found.append((spec.to_json(), str(place), cluster.workers, policies, progress))
            yield SimpleNamespace(
                markers=lambda under: set(), finish_work=lambda: None, storage=place
            )

        def written(spec, directory, label, called, progress, of=None):
            found.append((called, progress, of is None))

        monkeypatch.setattr(calls, "opened", opened)
        monkeypatch.setattr(calls, "complete", lambda *args: True)
        monkeypatch.setattr(calls, "write_artefact", written)
        calls.run_panel(**{"spec": "quick", "out": "out", "progress": True, **given})
        return repr(found)

    return run


def other_act(observation):
    return [1.0]


APPLIED: dict[str, dict[str, Any]] = {
    "judged": {
        "policy": other_act, "env_id": "IntegElasticPendulum-v0", "out": "elsewhere",
        "home": "stock", "integrators": ["rk4"], "dts": [0.05], "episodes": 3,
        "environment": {"max_torque": 1.0}, "workers": 2, "progress": False,
        "on_doubt": print, "varied": {"mass": [2.0]}, "command": "mine",
        "on_home": lambda line: None, "limit": True, "engines": ["mujoco"],
    },
    "panelled": {
        "spec": replace(read_spec("quick"), episodes=3), "out": "elsewhere", "workers": 3,
        "progress": False, "policies": "x", "command": "mine", "staged": False,
    },
}  # fmt: skip
NOT_FOR_THIS_MACHINE: dict[str, tuple[Any, str]] = {
    "executor": ("nowhere", "--executor must be one of"),
    "address": ("ray://head", "--address names a cluster of Ray or Dask"),
    "resources": (Resources(cores=2), "are asked of an engine such as Ray"),
}
UNUSABLE: dict[str, dict[str, tuple[Any, str]]] = {
    "judged": {
        **NOT_FOR_THIS_MACHINE,
        "obs_stats": ("vecnormalize.pkl", "are given for a policy's file"),
        "own_code": (True, "own_code is for the side-car"),
        "at": (("home",), "nothing is varied at home"),
        "spec": ("absent.toml", "absent.toml"),
        "on_cells": (parse_claim("loss > 0.1 in rk9").check_cell, "unknown cell in --fail-if"),
    },
    "panelled": NOT_FOR_THIS_MACHINE,
}
"""Parameters that a policy which is a function, or a panel, on this machine cannot have."""


@pytest.mark.parametrize(
    ("called", "function"), [("judged", integ_gym.evaluate), ("panelled", integ_gym.run_panel)]
)
def test_every_parameter_changes_what_is_done_or_is_refused(called, function, request):
    applied, unusable = APPLIED[called], UNUSABLE[called]
    assert {*applied, *unusable} == {*inspect.signature(function).parameters}
    run = request.getfixturevalue(called)
    before = run(workers=None)
    for name, value in applied.items():
        assert run(**{name: value}) != before, name
    for name, (value, fragment) in unusable.items():
        with pytest.raises(ValueError, match=fragment):
            run(**{name: value})


@pytest.mark.parametrize(
    ("given", "fragment"),
    [
        ({"workers": 3}, "`workers` of `resources` is said by `workers`"),
        ({"memory_gib": 3.0}, "`memory_gib` of `resources` is said by the spec"),
    ],
)
def test_a_resource_is_said_in_one_place(given, fragment, judged):
    with pytest.raises(ValueError, match=fragment):
        judged(resources=Resources(**given))


def test_a_film_of_an_object_refuses_what_is_for_files():
    with pytest.raises(ValueError, match="own_code is for the side-car"):
        of_policy.side_by_side(SimpleNamespace(act=act), ["rk4"], 0, env_id=PENDULUM, own_code=True)
