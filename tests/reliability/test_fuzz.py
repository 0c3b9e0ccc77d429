"""Commands and constructors given anything: they do it, or refuse it in one sentence."""

import gymnasium as gym
import pytest
from hostile import ARGUMENTS, VALUES, refused_or
from hypothesis import example, given, settings
from hypothesis import strategies as st
from recording import recorded
from victim import command

from integ_gym.cli import COMMANDS
from integ_gym.envs.registries import ENVIRONMENTS

NOWHERE = "/dev/null/out"
OPTIONS = (
    "--out", "--seeds", "--workers", "--trainer", "--memory-gib", "--policies", "--power", "--env",
    "--integrator", "--dt", "--env-arg", "--home", "--episodes", "--total-steps", "--obs-stats",
    "--depth", "--sample", "--format", "--output", "--policy", "--style", "--plant", "--nonsense",
)  # fmt: skip
WORDS = (
    "", "0", "-1", "1e9", "nan", "inf", "9" * 5000, "rk4", "IntegPendulum-v0", "Hopper-v5", "a=b",
    "a=[[[", "=", "module:Class", "/dev/zero", "/dev/null", ".", "\x1b[2J", "é", "\ud800", "%s",
    "'; DROP TABLE records; --", "SELECT 1", "quick", "show", "query", "verify", "merge", "stock",
)  # fmt: skip
BEGUN = st.sampled_from([(name,) for name in COMMANDS])
WORD = st.sampled_from((*OPTIONS, *WORDS)) | st.text(max_size=8)


@settings(max_examples=30)
@given(begun=BEGUN, words=st.lists(WORD, max_size=5))
def test_any_command_ends_with_a_code_and_a_sentence(begun, words):
    """It can write nowhere, so that nothing that takes long is begun."""
    code, told = command(*begun, *words, "--out", NOWHERE)
    assert code in (0, 2), told
    assert "Traceback" not in told
    if code == 2:
        assert told.splitlines()[-1].startswith("integ-gym"), told


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    recorded(folder / "evidence")
    return folder


@pytest.mark.parametrize("name", ["show", "query", "verify", "export"])
@settings(max_examples=5)
@example(words=["\ud800"])
@given(words=st.lists(WORD, max_size=3))
def test_any_look_at_evidence_ends_with_a_code_and_a_sentence(name, words, run):
    code, told = command("evidence", name, run, *words)
    assert code in (0, 2), told
    assert "Traceback" not in told


ANY = st.sampled_from(VALUES) | st.floats() | st.integers() | st.text(max_size=5)


@settings(max_examples=60)
@given(
    env_id=st.sampled_from(sorted(ENVIRONMENTS)),
    given_values=st.dictionaries(st.sampled_from(ARGUMENTS), ANY, max_size=3),
    action=ANY,
)
def test_any_arguments_make_an_environment_or_a_sentence(env_id, given_values, action):
    env = refused_or(lambda: gym.make(env_id, disable_env_checker=True, **given_values))
    if env is None:
        return
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation)
    stepped = refused_or(lambda: env.unwrapped.step([action]))
    assert stepped is None or env.observation_space.contains(stepped[0])
