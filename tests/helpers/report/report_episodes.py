"""What evidence would tell of a synthetic panel's episodes: plausible numbers, no simulation."""

from __future__ import annotations

import itertools

import numpy as np

from integ_gym.eval.panel.result import Panel
from integ_gym.eval.report.episodes import (
    MOST_POLICIES,
    Outcomes,
    Told,
    Trace,
    chosen,
    with_policies,
)
from integ_gym.train.policy import BoxActions, MlpPolicy

SAMPLES = 241


def told_of(panel: Panel, episodes: int = 20, trace_every: int = 4, seed: int = 0) -> Told:
    """Outcomes by the panel's rates, ledgers, and the traces that a page would choose."""
    rng = np.random.default_rng(seed)
    outcomes = {}
    for entry in panel.matrix:
        shape = (len(panel.row(entry.row).policies), episodes)
        names = [name for name in entry.labels if name != "none"] or ["planning_error"]
        won = rng.random(shape) < entry.success.estimate
        label = np.where(won, "none", rng.choice(names, shape))
        motor, numerics = rng.normal(8.0, 4.0, shape), rng.normal(0.0, 6.0, shape)
        time = np.where(won, rng.uniform(2.0, 8.0, shape), np.nan)
        traced = np.broadcast_to(np.arange(episodes) % trace_every == 0, shape)
        ledger = np.stack((motor, numerics, np.zeros(shape)))
        outcomes[entry.row, entry.cell] = Outcomes(label, ledger, time, traced)
    leads = chosen(panel, outcomes)
    keys = {
        (lead.row, cell, lead.seed, lead.episode): lead for lead in leads for cell in lead.cells
    }
    traces = tuple(_trace(key, outcomes, rng) for key in keys)
    places = list(dict.fromkeys((lead.row, lead.seed) for lead in leads))[:MOST_POLICIES]
    live = with_policies(panel, leads, {place: network(rng) for place in places})
    return Told(outcomes, tuple(leads), traces, live)


def network(rng: np.random.Generator, width: int = 64) -> MlpPolicy:
    """As large as PPO's, for the pendulum."""
    sizes = (3, width, width, 1)
    layers = tuple(
        (rng.normal(0.0, 0.3, (out, into)), rng.normal(0.0, 0.3, out))
        for into, out in itertools.pairwise(sizes)
    )
    return MlpPolicy(layers, "Tanh", BoxActions([-0.7], [0.7]))


def _trace(
    key: tuple[str, str, int, int],
    outcomes: dict[tuple[str, str], Outcomes],
    rng: np.random.Generator,
) -> Trace:
    row, cell, seed, episode = key
    own = outcomes[row, cell]
    label, totals = str(own.label[seed, episode]), own.ledger[:, seed, episode]
    share = np.sort(rng.random(SAMPLES))
    share = (share - share[0]) / (share[-1] - share[0])
    fields = {
        "record_id": rng.bytes(16).hex(),
        "length": SAMPLES - 1,
        "control_period": 0.05,
        "success": label == "none",
        "failure_label": label,
        "failure_reason": "" if label == "none" else f"it never came near on {cell}.",
        "time_to_success": None if label != "none" else float(own.time[seed, episode]),
        "return": -100.0,
        "initial_state": [3.2, 0.1],
        "energy_start": 0.05,
        "energy_end": 0.05 + float(totals[0] + totals[1] - totals[2]),
        "work_total": float(totals[0]),
        "energy_residual_total": float(totals[1]),
        "dissipated_total": float(totals[2]),
        "contact_loss_total": None,
        "clip_loss_total": 0.0,
    }
    return Trace(
        key,
        fields,
        0.05,
        {"theta": np.pi + np.cumsum(rng.normal(0.0, 0.2, SAMPLES))},
        {"torque_applied": 0.7 * np.sign(rng.normal(size=SAMPLES))},
        totals[:, None] * share,
    )
