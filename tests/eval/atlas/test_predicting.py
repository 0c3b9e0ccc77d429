"""What cannot be predicted is said in one sentence, with what can be."""

from __future__ import annotations

import pytest

from integ_gym.cli import main
from integ_gym.eval import doubt, predict


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (
            ["--engine", "mujoco", "--integrator", "Euler"],
            "nothing is predicted for mujoco Euler: the law was made on our own engine, none of "
            "whose integrators applies its map, symplectic_euler_implicit_damping; give RK4 of "
            "mujoco or an integrator of the native engine, or measure it by a panel",
        ),
        (
            ["--engine", "dart", "--integrator", "semi_implicit_euler"],
            "give an integrator of the native engine, or measure it by a panel",
        ),
        (
            ["--engine", "mujoco", "--integrator", "rk5"],
            "unknown integrator of mujoco 'rk5'. Did you mean 'RK4'? Valid choices: Euler, RK4,",
        ),
        (["--integrator", "Euler"], "unknown integrator 'Euler'. Valid choices: explicit_euler,"),
        (["--engine", "ode", "--integrator", "Euler"], "unknown engine 'ode'"),
    ],
)
def test_a_map_without_a_twin_of_ours_is_refused(given, told, capsys):
    assert main(["predict", *given, "--dt", "0.05"]) == 2
    assert told in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("command", ["predict", "train", "play"])
def test_what_has_an_option_is_not_given_twice(command, capsys):
    given = ["--integrator", "rk4", "--dt", "0.05", "--env-arg", "dt=0.02"]
    assert main([command, *given]) == 2
    assert "give --dt in place of --env-arg dt" in capsys.readouterr().err


def test_the_environment_is_not_given_twice_either(capsys):
    given = ["--integrator", "rk4", "--dt", "0.05", "--env-arg", "env_id=IntegPendulum-v0"]
    assert main(["predict", *given]) == 2
    assert "give --env in place of --env-arg env_id" in capsys.readouterr().err


def test_a_map_that_is_ours_is_predicted_alike_on_any_engine(capsys):
    own = ["--env-arg", "max_torque=0.7", "--env-arg", "start=hanging", "--dt", "0.05"]
    assert main(["predict", "--integrator", "rk4", *own]) == 0
    native = capsys.readouterr().out
    assert main(["predict", "--engine", "mujoco", "--integrator", "RK4", *own]) == 0
    assert capsys.readouterr().out == native.replace("rk4 dt=0.05", "mujoco RK4 dt=0.05")


def test_beyond_what_the_law_was_fitted_on_nothing_is_promised(capsys):
    """From upright, the start unless another is given, hardly any torque is the least."""
    assert main(["predict", "--integrator", "rk4", "--dt", "0.05"]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "Not known of rk4 dt=0.05: the limit of the control is" in told
    assert "% interval" not in told
    assert "coarsest safe step – whose interval ends below a loss of 0.2" in told


def test_where_numerics_do_most_of_the_task_nothing_is_promised(capsys):
    """In 20 s explicit Euler swings the pendulum up with hardly any torque at 0.05 s."""
    own = ["--env-arg", "max_torque=0.64", "--env-arg", "start=hanging"]
    own += ["--control-period", "0.05", "--integrator", "explicit_euler", "--env-arg"]
    assert main(["predict", *own, "duration=19", "--dt", "0.05"]) == 0
    assert "of the truth's, and the law was fitted where it is" in " ".join(
        capsys.readouterr().out.split()
    )
    assert main(["predict", *own, "duration=10", "--dt", "0.05"]) == 0
    assert "of it for help of the numerics." in " ".join(capsys.readouterr().out.split())


def test_no_step_is_called_safe_that_the_law_has_not_seen():
    given = {"max_torque": 0.6, "start": "hanging", "duration": 20.0}
    found = predict(integrator="explicit_euler", dt=0.0125, control_period=0.05, **given)
    assert found.within
    assert found.safe_dt is not None
    assert found.safe_dt < 0.05
    told = doubt("IntegPendulum-v0", {**given, "integrator": "explicit_euler", "dt": 0.05})
    assert told is not None
    assert "is not known" in told


def test_where_numerics_take_more_than_the_law_saw_nothing_is_promised():
    given = {"max_torque": 1.2, "start": "hanging", "duration": 10.0}
    found = predict(integrator="implicit_euler", dt=0.05, control_period=0.05, **given)
    assert found.quantities.critical_ratio > found.seen_ratios[1]
    assert not found.within


def test_of_another_environment_nothing_is_promised(capsys):
    given = ["--env-arg", "max_force=0.5", "--integrator", "rk4", "--dt", "0.02"]
    assert main(["predict", "--env", "IntegCartPoleSwingUp-v0", *given]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "the law was fitted on IntegPendulum-v0, and is not one of IntegCartPoleSwingUp" in told
    assert doubt("IntegCartPoleSwingUp-v0", {"integrator": "explicit_euler", "dt": 0.02}) is None


def test_a_step_is_safe_whose_interval_ends_below_what_a_panel_calls_a_failure():
    given = {"max_torque": 0.714, "start": "hanging", "duration": 10.0, "control_period": 0.05}
    coarse, fine = (predict(integrator="symplectic_euler", dt=dt, **given) for dt in (0.05, 0.025))
    assert fine.interval[1] < 0.2 < coarse.interval[1]
    assert coarse.safe_dt == fine.safe_dt == 0.025
    exact = predict(integrator="rk4", dt=0.05, **given)
    assert exact.safe_dt == 0.05
    assert exact.half_width < fine.half_width < coarse.half_width


def test_where_nothing_has_to_be_lifted_no_control_is_the_least(capsys):
    assert main(["predict", "--integrator", "rk4", "--dt", "0.05", "--env-arg", "gravity=0"]) == 2
    assert "the goal takes no energy" in capsys.readouterr().err
