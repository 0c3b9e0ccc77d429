"""Records as MCAP files of ROS 2 messages, one for each episode."""

from __future__ import annotations

import json
import math
from functools import partial
from pathlib import Path
from typing import Any

from integ_gym.support.optional import load

from .record import EvidenceRecord
from .selection import Columns, Selection, column, columns_of

_ros2 = partial(load, "mcap_ros2.writer", "exchange")

PREFIX = "/evidence/"
"""Of the topics of single columns."""

JOINTS = "/joint_states"

_RATE = "_dot"
"""What the name of a coordinate's rate ends with."""

_FLOAT = "float64 data\n"

_JOINT_STATE = f"""\
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
{"=" * 80}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{"=" * 80}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


def write_mcap(chosen: Selection, folder: Path) -> int:
    """Write a file for each record; how many.

    The state is a `sensor_msgs/msg/JointState` at every control instant, every column of the trace
    a `std_msgs/msg/Float64`, of control steps at the instant at which the step begins. Times are
    simulated, from 0. The record, units, frames and meanings are metadata of the file.
    """
    columns, count = columns_of(chosen.columns), 0
    for record in chosen.episodes():
        with (folder / f"{record['record_id']}.mcap").open("wb") as file:
            _write(record, columns, chosen.columns, file)
        count += 1
    return count


def _write(
    record: EvidenceRecord, columns: Columns, facts: dict[str, dict[str, str]], file: Any
) -> None:
    with _ros2().Writer(file) as writer:
        real = writer.register_msgdef("std_msgs/msg/Float64", _FLOAT)
        joints = writer.register_msgdef("sensor_msgs/msg/JointState", _JOINT_STATE)
        rows = len(record.trace["reward"]) + 1
        seconds = record.trace.get("time")  # or else the numbers of the instants
        times = range(rows) if seconds is None else [round(1e9 * x) for x in seconds.tolist()]
        states = {name: column(record, name, rows) for name in columns.states}
        names = [name for name in states if f"{name}{_RATE}" in states]
        values = {name: record.trace[name] for name in facts if name in record.trace}
        for place, time in enumerate(times):
            stamp = {"log_time": time, "sequence": place}
            if names:
                message = _joint_state(names, states, place, time)
                writer.write_message(JOINTS, joints, message, **stamp)
            for name, numbers in values.items():
                if place < len(numbers) and math.isfinite(numbers[place]):
                    message = {"data": float(numbers[place])}
                    writer.write_message(f"{PREFIX}{name}", real, message, **stamp)
        summary = record.summary().items()
        texts = {name: x if isinstance(x, str) else json.dumps(x) for name, x in summary}
        writer.add_metadata("integ_gym.record", texts)
        for about in ("unit", "frame", "meaning", "at"):
            said = {name: facts[name][about] for name in values}
            writer.add_metadata(f"integ_gym.{about}", said)


def _joint_state(names: list[str], states: dict[str, Any], place: int, time: int) -> dict[str, Any]:
    """A message of the state components whose rate is one too."""
    seconds, rest = divmod(time, 10**9)
    return {
        "header": {"stamp": {"sec": seconds, "nanosec": rest}, "frame_id": ""},
        "name": names,
        "position": [float(states[name][place]) for name in names],
        "velocity": [float(states[f"{name}{_RATE}"][place]) for name in names],
        "effort": [],
    }
