"""Rows of episodes as columns of records."""

from __future__ import annotations

import numpy as np
import pyarrow as pa

from integ_gym.envs.environment import environment_setup
from integ_gym.evidence.episodes import EpisodeHead, EpisodeHeads, EpisodeLog, Layout
from integ_gym.evidence.labels import EpisodeContext
from integ_gym.evidence.table import unhashed_table


def test_no_zero_is_negative():
    """Not in traces and summaries, nor what is rounded to zero in the narrower columns."""
    setup = environment_setup("IntegPendulum-v0", {})
    layout = Layout(setup.plant, setup.task, None)
    log = EpisodeLog(layout, [EpisodeContext("run", "cell", trace_every=1)])
    rows = np.full((len(layout), 5), -0.0)
    rows[layout.place("sensed_theta_dot")] = -1e-60
    log.add(rows, np.array([5]), EpisodeHeads.of([EpisodeHead(0, 1, "1/0", 0, 0)]))
    table = unhashed_table(log, "IntegPendulum-v0", [(setup, 0)])
    seen = 0
    for name in table.column_names:
        values = table[name].combine_chunks()
        if pa.types.is_list(values.type):
            values = values.flatten()
        if pa.types.is_floating(values.type):
            numbers = values.drop_null().to_numpy(zero_copy_only=False)
            assert not np.signbit(numbers[numbers == 0.0]).any(), name
            seen += numbers.size
    assert seen > 5 * 10
