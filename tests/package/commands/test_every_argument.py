"""No argument of `evaluate`, `panel`, `train` and `watch` is neither applied nor refused.

Every option of a command and every parameter of the function behind it has a case here, in which
it changes what is done; one that is added without a case fails. Combinations in which an argument
could not act are refused.
"""

from __future__ import annotations

import inspect
from contextlib import contextmanager, suppress
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

import integ_gym
from integ_gym.cli import main
from integ_gym.commands import evaluate, panel, train, watch
from integ_gym.eval import watch as of_policy
from integ_gym.eval.panel import existing
from integ_gym.eval.panel import run as calls
from integ_gym.eval.panel.spec import built_in_spec
from integ_gym.support.executors import Resources
from integ_gym.train import command as training

PENDULUM = "IntegPendulum-v0"
MODULES: dict[str, Any] = {"evaluate": evaluate, "panel": panel, "train": train, "watch": watch}


class Stopped(Exception):
    """Ends a command where its work would begin."""


def act(observation):
    return [0.0]


def _plain(value: Any) -> Any:
    """Something that can be compared and shown."""
    return repr(value)


@pytest.fixture
def done(monkeypatch, tmp_path):
    """Runs a command up to its work, and tells what that would be."""
    calls_made: list[Any] = []

    def note(name, stop=True, result=None):
        def called(*args, **kwargs):
            kwargs.pop("command", None)
            calls_made.append((name, _plain(args), _plain(sorted(kwargs.items()))))
            if stop:
                raise Stopped
            return result

        return called

    told = SimpleNamespace(warnings=(), verdicts=(1,), said=str)
    monkeypatch.setattr(evaluate, "evaluate", note("evaluate"))
    monkeypatch.setattr(panel, "run_panel", note("run", stop=False, result=told))
    for name in (
        "print_plan",
        "print_power",
        "print_headline",
        "print_details",
        "print_next",
        "print_verdicts",
    ):
        monkeypatch.setattr(panel, name, note(name, stop=False))
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
PANEL = ("panel", "--out", "out")
TRAIN = ("train", "--out", "out")
WATCH = ("watch", "policy")
STOPS = (*TRAIN, "--env", "IntegCartPoleSwingUp-v0", "--engine", "mujoco", "--integrator", "RK4")
CASES: dict[str, dict[str, tuple[tuple[str, ...], ...]]] = {
    "evaluate": {
        "file": (EVALUATE, ("evaluate", "other.zip", *EVALUATE[2:])),
        "policy": (EVALUATE, ("evaluate", "--policy", "a:b", *EVALUATE[2:])),
        "env": (EVALUATE, (*EVALUATE, "--env", "IntegCartPole-v0")),
        "out": (EVALUATE, (*EVALUATE, "--out", "elsewhere")),
        "integrator": (EVALUATE, (*EVALUATE, "--integrator", "rk4")),
        "dt": (EVALUATE, (*EVALUATE, "--dt", "0.05")),
        "env_arg": (EVALUATE, (*EVALUATE, "--env-arg", "max_torque=1.0")),
        "success_return": (
            ("evaluate", "policy.zip", "--env", "Hopper-v5", "--out", "out"),
            (
                "evaluate",
                "policy.zip",
                "--env",
                "Hopper-v5",
                "--out",
                "out",
                "--success-return",
                "5",
            ),
        ),
        "home": (EVALUATE, (*EVALUATE, "--home", "stock")),
        "obs_stats": (EVALUATE, (*EVALUATE, "--obs-stats", "vecnormalize.pkl")),
        "own_code": (EVALUATE, (*EVALUATE, "--own-code")),
        "episodes": (EVALUATE, (*EVALUATE, "--episodes", "3")),
        "workers": (EVALUATE, (*EVALUATE, "--workers", "2")),
        "no_progress": (EVALUATE, (*EVALUATE, "--no-progress")),
        "executor": (EVALUATE, (*EVALUATE, "--executor", "ray")),
        "address": (EVALUATE, (*EVALUATE, "--address", "ray://head:1")),
        "cores_per_worker": (EVALUATE, (*EVALUATE, "--cores-per-worker", "2")),
        "gpus_per_worker": (EVALUATE, (*EVALUATE, "--gpus-per-worker", "1")),
    },
    "panel": {
        "spec": (PANEL, (*PANEL, "engines", "--policies", "x")),
        "out": (PANEL, ("panel", "--out", "elsewhere")),
        "power": (PANEL, (*PANEL, "--power")),
        "plan": (PANEL, ("panel", "--plan")),
        "trainer": (PANEL, (*PANEL, "--trainer", "sb3")),
        "memory_gib": (PANEL, (*PANEL, "--memory-gib", "4")),
        "policies": (PANEL, (*PANEL, "--policies", "x")),
        "seeds": (PANEL, (*PANEL, "--seeds", "80")),
        "sign": (PANEL, (*PANEL, "--sign", "key")),
        "workers": (PANEL, (*PANEL, "--workers", "2")),
        "no_progress": (PANEL, (*PANEL, "--no-progress")),
        "executor": (PANEL, (*PANEL, "--executor", "ray")),
        "address": (PANEL, (*PANEL, "--address", "ray://head:1")),
        "cores_per_worker": (PANEL, (*PANEL, "--cores-per-worker", "2")),
        "gpus_per_worker": (PANEL, (*PANEL, "--gpus-per-worker", "1")),
        "verbose": (PANEL, (*PANEL, "--verbose")),
    },
    "train": {
        "algorithm": (TRAIN, (*TRAIN, "--algorithm", "sac")),
        "env_id": (TRAIN, (*TRAIN, "--env", "IntegCartPole-v0")),
        "out": (TRAIN, ("train", "--out", "elsewhere")),
        "trainer": (TRAIN, (*TRAIN, "--trainer", "fleet")),
        **{
            dest: (TRAIN, (*TRAIN, *words))
            for dest, words in {
                "force": ("--force",),
                "tensorboard": ("--no-tensorboard",),
                "progress": ("--no-progress",),
                "integrator": ("--integrator", "rk4"),
                "dt": ("--dt", "0.025"),
                "control_period": ("--control-period", "0.1"),
                "engine": ("--engine", "mujoco", "--integrator", "RK4"),
                "duration": ("--duration", "5"),
                "action_latency": ("--action-latency", "0.05"),
                "sensor_period": ("--sensor-period", "0.1"),
                "observation_noise": ("--observation-noise", "0.1"),
                "fallback": ("--fallback", "zero"),
                "max_speed": ("--max-speed", "8"),
                "start": ("--start", "hanging"),
                "max_torque": ("--max-torque", "1"),
                "env_arg": ("--env-arg", "mass=1.2"),
                "seed": ("--seed", "7"),
                "total_steps": ("--total-steps", "8192"),
                "n_envs": ("--n-envs", "8"),
                "learning_rate": ("--learning-rate", "1e-4"),
                "discount_time": ("--discount-time", "2"),
                "reward_scale": ("--reward-scale", "1"),
                "net_arch": ("--net-arch", "32"),
                "trace_every": ("--trace-every", "5"),
                "n_steps": ("--n-steps", "128"),
                "batch_size": ("--batch-size", "128"),
                "n_epochs": ("--n-epochs", "3"),
                "gae_lambda": ("--gae-lambda", "0.9"),
                "clip_range": ("--clip-range", "0.1"),
                "ent_coef": ("--ent-coef", "0.01"),
                "vf_coef": ("--vf-coef", "0.4"),
                "max_grad_norm": ("--max-grad-norm", "0.4"),
                "activation": ("--activation", "ReLU"),
                "log_std_init": ("--log-std-init", "-1"),
                "normalize_advantage": ("--no-normalize-advantage",),
                "target_kl": ("--target-kl", "0.1"),
                "learning_rate_end": ("--learning-rate-end", "1e-5"),
            }.items()
        },
        "contact": (
            STOPS,
            (*STOPS, "--contact", "engine"),
        ),
        **{
            dest: ((*TRAIN, "--algorithm", "sac"), (*TRAIN, "--algorithm", "sac", *words))
            for dest, words in {
                "buffer_size": ("--buffer-size", "5000"),
                "gradient_steps": ("--gradient-steps", "2"),
                "initial_entropy": ("--initial-entropy", "0.2"),
                "learning_starts": ("--learning-starts", "10"),
                "tau": ("--tau", "0.01"),
                "train_freq": ("--train-freq", "2"),
            }.items()
        },
    },
    "watch": {
        "run": (("watch", "policy"), ("watch", "policy/policy.zip")),
        "record": (("watch", "panel"), ("watch", "panel", "3f9a")),
        "on": (WATCH, (*WATCH, "--on", "rk4")),
        "seed": (WATCH, (*WATCH, "--seed", "3")),
        "own_code": (WATCH, (*WATCH, "--own-code")),
    },
}
"""By command and argument: words without it and with it, of which another thing is done."""


@pytest.mark.parametrize("name", CASES)
def test_every_option_has_a_case(name):
    module = MODULES[name]
    parsers = [module.parser()]
    if name == "train":
        parsers += [module.parser(algorithm=other) for other in training.ALGORITHMS]
    known = {action.dest for parser in parsers for action in parser._actions} - {"help"}
    written = {"out"} if name == "watch" else set()  # which tests/eval/film holds
    assert known == {*CASES[name], *written}


@pytest.mark.parametrize(("name", "option"), [(n, o) for n in CASES for o in CASES[n]])
def test_every_option_changes_what_is_done(name, option, done):
    without, with_it = CASES[name][option]
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
    ((*PANEL, "--trainer", "sb3", "--memory-gib", "4"), "nothing is trained by it here; leave it"),
    ((*PANEL, "--policies", "x", "--memory-gib", "4"), "nothing is trained by it here; leave it"),
    ((*PANEL, "--plan"), "--plan says what a panel costs and runs nothing, so --out says nothing"),
    ((*TRAIN, "--env-arg", "dt=0.1", "--dt", "0.1"), "give --dt in place of --env-arg dt"),
    ((*TRAIN, "--trainer", "fleet", "--algorithm", "sac"), "the fleet trains PPO"),
    ((*TRAIN, "--trainer", "fleet", "--env", "Acrobot-v1"), "with --trainer sb3"),
    ((*TRAIN, "--integrator", "rk4", "--env-arg", 'mixture=[{"integrator": "rk4", "dt": 0.1}]'),
     "acts nowhere"),
    (("watch", "panel", "3f9a", "--seed", "3"), "--seed is for a trained policy"),
    (("watch", "panel", "--own-code"), "is no trained policy; give the id of one"),
    (("watch", "panel", "--on", "rk4"), "is no trained policy; give the id of one"),
    (("diagnose", "--example", "drift", "--workers", "2"), "so --workers says nothing"),
]  # fmt: skip


@pytest.mark.parametrize(("words", "fragment"), REFUSED)
def test_what_could_not_act_is_refused(words, fragment, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "panel" / "evidence").mkdir(parents=True)
    assert main(list(words)) == 2
    assert fragment in capsys.readouterr().err.replace("\n", " ")


_POWER_USES = {"spec", "out", "power", "seeds", "help"}


@pytest.mark.parametrize(
    "option",
    [a for a in panel.parser()._actions if a.dest not in _POWER_USES],
    ids=lambda a: a.dest,
)
def test_what_runs_nothing_refuses_what_is_for_a_run(option):
    value = {None: ["1"], 0: []}[option.nargs]
    if option.dest == "trainer":
        value = ["sb3"]
    elif option.dest == "executor":
        value = ["ray"]
    elif option.dest == "cores_per_worker":
        value = ["2"]
    with pytest.raises(ValueError, match=f"so {option.option_strings[0]} says nothing; leave it"):
        panel.main(["--power", option.option_strings[0], *value])


@pytest.fixture
def judged(monkeypatch):
    """Calls `evaluate` up to its work, and tells what that would be."""

    def run(**given):
        found: list[Any] = []

        def evaluated(given_policy, spec, place, command, **options):
            known = (
                given_policy.policy.policy_id,
                str(given_policy.provenance),
                given_policy.seed,
            )
            cluster = options.pop("cluster")
            found.append((known, spec.to_json(), str(place), command, cluster.workers, options))

        monkeypatch.setattr(existing, "evaluate_existing", evaluated)
        lines: list[str] = []
        base = {"policy": act, "env_id": PENDULUM, "out": "out", "on_home": lambda line: None}
        existing.evaluate(**{**base, **given})
        found.append(lines)
        return _plain(found)

    return run


def other_act(observation):
    return [1.0]


EVALUATIONS: dict[str, Any] = {
    "policy": other_act,
    "env_id": "IntegElasticPendulum-v0",
    "out": "elsewhere",
    "home": "stock",
    "integrators": ["rk4"],
    "dts": [0.05],
    "episodes": 3,
    "environment": {"max_torque": 1.0},
    "workers": 2,
    "progress": False,
    "on_doubt": print,
    "command": "mine",
}
NOT_FOR_THIS: dict[str, tuple[Any, str]] = {
    "obs_stats": ("vecnormalize.pkl", "are given for a policy's file"),
    "own_code": (True, "own_code lets a side-car name classes"),
    "executor": ("nowhere", "--executor must be one of"),
    "address": ("ray://head", "--address names a cluster of Ray or Dask"),
    "resources": (Resources(cores=2), "are asked of an engine such as Ray"),
}
"""Parameters that a policy which is a function, on this machine, cannot have."""


def test_every_parameter_of_evaluate_has_a_case():
    known = {*inspect.signature(integ_gym.evaluate).parameters}
    assert known == {*EVALUATIONS, *NOT_FOR_THIS, "on_home"}


@pytest.mark.parametrize("name", EVALUATIONS)
def test_every_parameter_of_evaluate_changes_what_is_done(name, judged):
    assert judged() != judged(**{name: EVALUATIONS[name]})


@pytest.mark.parametrize("name", NOT_FOR_THIS)
def test_what_evaluate_cannot_use_is_refused(name, judged):
    value, fragment = NOT_FOR_THIS[name]
    with pytest.raises(ValueError, match=fragment):
        judged(**{name: value})


def test_what_is_taken_as_home_is_told(judged):
    lines: list[str] = []
    judged(on_home=lines.append)
    assert len(lines) == 1


def test_workers_are_said_in_one_place(judged):
    with pytest.raises(ValueError, match="`workers` of `resources` is said by `workers`"):
        judged(resources=Resources(workers=3))
    with pytest.raises(ValueError, match="`memory_gib` of `resources` is said by the spec"):
        judged(resources=Resources(memory_gib=3.0))


@pytest.fixture
def panelled(monkeypatch, tmp_path):
    """Calls `run_panel` up to its work, and tells what that would be."""
    monkeypatch.chdir(tmp_path)

    def run(**given):
        found: list[Any] = []

        @contextmanager
        def opened(spec, place, cluster, policies):
            found.append((spec.to_json(), str(place), cluster.workers, policies))
            yield SimpleNamespace(markers=lambda under: set(), finish_work=lambda: None)

        def noted(*args, **kwargs):
            found.append(sorted((name, str(value)) for name, value in kwargs.items()))

        monkeypatch.setattr(calls, "opened", opened)
        monkeypatch.setattr(calls, "complete", noted)
        monkeypatch.setattr(calls, "_write", noted)
        calls.run_panel(**{"spec": "quick", "out": "out", "progress": True, **given})
        return _plain(found)

    return run


PANELS: dict[str, Any] = {
    "spec": replace(built_in_spec("quick"), episodes=3),
    "out": "elsewhere",
    "workers": 3,
    "progress": False,
    "policies": "x",
    "command": "mine",
    "staged": False,
}
NOT_FOR_A_PANEL_HERE: dict[str, tuple[Any, str]] = {
    **{name: NOT_FOR_THIS[name] for name in ("executor", "address", "resources")},
}


def test_every_parameter_of_run_panel_has_a_case():
    known = {*inspect.signature(integ_gym.run_panel).parameters}
    assert known == {*PANELS, *NOT_FOR_A_PANEL_HERE}


@pytest.mark.parametrize("name", PANELS)
def test_every_parameter_of_run_panel_changes_what_is_done(name, panelled):
    assert panelled(workers=None) != panelled(**{name: PANELS[name]})


@pytest.mark.parametrize("name", NOT_FOR_A_PANEL_HERE)
def test_what_run_panel_cannot_use_is_refused(name, panelled):
    value, fragment = NOT_FOR_A_PANEL_HERE[name]
    with pytest.raises(ValueError, match=fragment):
        panelled(**{name: value})


def test_a_film_of_an_object_refuses_what_is_for_files():
    with pytest.raises(ValueError, match="own_code lets a side-car name classes"):
        of_policy.side_by_side(SimpleNamespace(act=act), ["rk4"], 0, env_id=PENDULUM, own_code=True)
