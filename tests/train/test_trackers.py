"""A callback's numbers arrive in Weights & Biases and MLflow, both without a network."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest
from house import ROOT

PACKAGES = ROOT / ".trackers" / "lib" / f"python3.{sys.version_info.minor}" / "site-packages"
"""The two libraries, as ``make trackers`` installs them; all else is this interpreter's."""

TRAINING = """
import json
import site
import sys

site.addsitedir(sys.argv[1])
import mlflow
import wandb
from stable_baselines3 import PPO

from integ_gym import DiscretizationCallback

run = wandb.init(project="gap")
number = mlflow.start_run().info.run_id
callback = DiscretizationCallback(
    64, env_id="IntegPendulum-v0", home="stock", others=["integrator=rk4,dt=0.05"], episodes=1
)
PPO("MlpPolicy", "Pendulum-v1", n_steps=32, batch_size=32, n_epochs=1, seed=0).learn(
    128, callback=callback
)
client = mlflow.MlflowClient()
entered = {
    name: [[one.step, one.value] for one in client.get_metric_history(number, name)]
    for name in client.get_run(number).data.metrics
}
sent = {name: value for name, value in dict(run.summary).items() if not name.startswith("_")}
mlflow.end_run()
run.finish()
print(json.dumps([sent, entered]))
"""


@pytest.mark.slow
def test_both_libraries_keep_the_numbers_offline(tmp_path):
    assert PACKAGES.is_dir(), "run `make trackers`, as `make test-slow` does"
    offline = {
        "WANDB_MODE": "offline", "WANDB_SILENT": "true", "WANDB_ERROR_REPORTING": "false",
        "MLFLOW_TRACKING_URI": (tmp_path / "mlflow").as_uri(), "MLFLOW_ALLOW_FILE_STORE": "true",
    }  # fmt: skip
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", TRAINING, str(PACKAGES)],
        cwd=tmp_path, env={**os.environ, **offline}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    sent, entered = json.loads(done.stdout.splitlines()[-1])
    names = {
        f"discretization/{what}{end}"
        for what in ("return", "success") for end in ("/home", "/rk4-dt-0.05", "_gap")
    }  # fmt: skip
    assert set(entered) == names
    assert set(sent) == {*names, "global_step"}
    assert sent["global_step"] == 128
    for name, kept in entered.items():
        assert [step for step, _ in kept] == [64, 128]
        assert kept[-1][1] == sent[name]
    assert [*tmp_path.glob("wandb/offline-run-*/*.wandb")]
