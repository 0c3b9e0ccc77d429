"""Settings in which a published robot loses little: the coarsest and the cheapest.

``python benchmarks/robot_plain.py go1 DIR RUN 4 | python benchmarks/robot_costs.py RUN``; of what
several such loops print, one after the other, the least time of a setting is taken. A setting is
safe where success is at most 0.1 lower than at home, by the upper end of the panel's 95 % interval,
paired by starts. Settings are integrator, step and solver; processor time is that of the loop of
MuJoCo and onnxruntime, for 10 s of motion.
"""

import json
import sys
from pathlib import Path

MOST = 0.1
"""Loss of success that is safe."""


def main(run):
    panel = json.loads(Path(run, "panel.json").read_text(encoding="utf-8"))
    times = {}
    for line in filter(lambda line: line.endswith(" ms\n"), sys.stdin):
        words, _, time = line.removesuffix(" ms\n").rpartition(" ")
        cell = words.rpartition(": ")[0]
        times[cell] = min(float(time), times.get(cell, float("inf")))
    cells = {cell["name"]: cell for cell in panel["cells"] if cell["kind"] != "limit"}
    home = panel["rows"][0]["home"]
    period = cells[home]["control_period"]
    alike = [
        name
        for name, cell in cells.items()
        if cell["environment"].keys() <= {"solver"} and cell["control_period"] == period
    ]
    lost = {one["cell"]: one["success"] for one in panel["paired"] if one["row"] == "policy"}
    lost[home] = dict.fromkeys(("estimate", "low", "high"), 0.0)
    safe = [cell for cell in alike if cell in times and lost[cell]["high"] <= MOST]
    coarsest = max(safe, key=lambda cell: (cells[cell]["dt"], -times[cell]))
    cheapest = min(safe, key=times.__getitem__)
    for words, cell in ("home", home), ("coarsest", coarsest), ("cheapest", cheapest):
        estimate, low, high = (lost[cell][name] for name in ("estimate", "low", "high"))
        print(f"{words}: {cell}, lost {estimate:.2f} ({low:.2f} to {high:.2f}), {times[cell]:g} ms")


if __name__ == "__main__":
    main(*sys.argv[1:])
