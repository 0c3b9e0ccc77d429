"""Commands on their way, by the rule as it is written."""

from __future__ import annotations

import numpy as np


class Wire:
    """What becomes of commands, by the rule as it is written: the newest that has arrived acts.

    Args:
        idle: acts before.
        steps: of a decision.
        latency: steps by which every command is late.
        jitter: most steps by which it is later.
        hold: probability that it does not arrive.
        seed: of the first episode.
    """

    def __init__(self, idle, steps, latency=0, jitter=0, hold=0.0, seed=None):
        self.steps, self.latency, self.jitter, self.hold = steps, latency, jitter, hold
        numbers = np.random.SeedSequence(seed, spawn_key=(0x4E03, 0))
        self.rng = np.random.Generator(np.random.PCG64(numbers))
        self.arrived, self.decision = [(-1, -1, idle)], 0

    def give(self, command):
        """The commands of a decision's steps; the draws are there to look at."""
        held, late = self.rng.random(2) if self.jitter or self.hold else (1.0, 0.0)
        self.held = held < self.hold
        self.late = self.latency + int(late * (self.jitter + 1))
        begin = self.decision * self.steps
        if not self.held:
            self.arrived.append((self.decision, begin + self.late, command))
        self.decision += 1
        there = [
            [one for one in self.arrived if one[1] <= instant]
            for instant in range(begin, begin + self.steps)
        ]
        return [max(some, key=lambda one: one[0])[2] for some in there]
