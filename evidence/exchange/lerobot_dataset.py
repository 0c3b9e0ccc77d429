"""Records as a LeRobot data set, version 3: frames of all episodes in few files."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.support.files.writing import write_json
from integ_gym.support.packages.extras import load

from ..episodes.record import EvidenceRecord
from ..schema.errors import EvidenceError
from ..schema.extra import parquet, pyarrow
from .frame_statistics import FrameStatistics
from .selection import Selection
from .steps import (
    NO_CHOICE,
    Columns,
    actions_of,
    columns_of,
    is_discrete,
    stacked_instants,
    stacked_steps,
)

Array = npt.NDArray[Any]

VERSION = "v3.0"
FRAMES_PER_FILE = 500_000
FILES_PER_CHUNK = 1000
FILE_MB = 100
"""What tools that add to the data set keep its files below."""

_PATH = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"

_COUNTERS = {
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}

_pandas = partial(load, "pandas", "exchange")


def write_lerobot(chosen: Selection, folder: Path) -> int:
    """Write a data set; the number of episodes.

    A frame is a control instant with the decision that was taken there and what the control step
    that followed brought; the last instant, at which nothing is decided, has no frame.

    Raises:
        EvidenceError: for records of several environments or control periods, or of one of which
            no whole number makes a second.
    """
    fps, columns = _frames_per_second(chosen), columns_of(chosen.columns)
    features = _features(chosen, columns)
    frames = _Frames(folder, features)
    tasks: dict[str, int] = {}
    told: list[dict[str, Any]] = []
    for record in chosen.episodes():
        values = _values(record, columns, features)
        if values is None:
            chosen.leave_out(NO_CHOICE)
            continue
        task = str(record["metric_definition"] or record["env_id"])
        number = tasks.setdefault(task, len(tasks))
        told.append({**frames.add(values, number, fps), "tasks": [task], **_record(record)})
    frames.close()
    if not told:
        raise EvidenceError(f"all records are episodes {NO_CHOICE}; export to another format")
    _write_meta(folder, chosen, features, tasks, told, fps, frames)
    return len(told)


def _frames_per_second(chosen: Selection) -> int:
    periods = chosen.distinct("control_period")
    if len(periods) > 1:
        listed = ", ".join("unknown" if x is None else f"{x:g} s" for x in periods)
        raise EvidenceError(
            f"the records have control periods {listed}, and a LeRobot data set has one; choose it "
            'with --where "control_period = …"'
        )
    (period,) = periods
    fps = 0 if period is None else round(1.0 / period)
    if not fps or abs(fps * period - 1.0) > 1e-6:
        told = "not known" if period is None else f"{period:g} s"
        raise EvidenceError(
            f"the control period is {told}, and LeRobot counts whole frames per second; export to "
            "another format"
        )
    return fps


def _features(chosen: Selection, columns: Columns) -> dict[str, dict[str, Any]]:
    """What a frame holds, as LeRobot describes it."""
    discrete = is_discrete(chosen.env_id, chosen.distinct("arguments")[0])
    kinds = {
        "observation.state": ("float32", columns.sensed),
        "observation.environment_state": ("float64", columns.states),
        "action": ("int64", ("choice",)) if discrete else ("float32", columns.controls),
        "next.reward": ("float32", ("reward",)),
        "next.done": ("bool", ("done",)),
        "next.success": ("bool", ("success",)),
        "evidence": ("float64", _further(columns)),
    }
    made = {key: _feature(kind, list(names)) for key, (kind, names) in kinds.items() if names}
    return made | {key: _feature(kind, None) for key, kind in _COUNTERS.items()}


def _further(columns: Columns) -> tuple[str, ...]:
    """Columns that LeRobot has no name for."""
    return (*columns.instants, *columns.controls, *columns.steps)


def _feature(kind: str, names: list[str] | None) -> dict[str, Any]:
    return {"dtype": kind, "shape": [len(names or [0])], "names": names}


def _values(
    record: EvidenceRecord, columns: Columns, features: dict[str, Any]
) -> dict[str, Array] | None:
    """Features of all frames of an episode; None where its actions are none of the set."""
    actions = actions_of(record, columns.controls)
    if actions is None:
        return None
    length = len(record.trace["reward"])
    last = np.arange(length) == length - 1
    instants = stacked_instants(record, columns.instants)[:-1]
    steps = stacked_steps(record, (*columns.controls, *columns.steps))
    values = {
        "observation.state": stacked_instants(record, columns.sensed)[:-1],
        "observation.environment_state": stacked_instants(record, columns.states)[:-1],
        "action": actions,
        "next.reward": record.trace["reward"],
        "next.done": last,
        "next.success": last & bool(record["success"]),
        "evidence": np.concatenate((instants, steps), axis=1),
    }
    return {
        key: np.asarray(value).reshape(length, -1).astype(features[key]["dtype"])
        for key, value in values.items()
        if key in features
    }


def _record(record: EvidenceRecord) -> dict[str, Any]:
    """The whole record beside what LeRobot says of an episode."""
    summary = json.dumps(record.summary(), ensure_ascii=False, allow_nan=False)
    return {"integ_gym.record_id": record["record_id"], "integ_gym.record": summary}


class _Frames:
    """Frames on their way to files, and their statistics.

    Args:
        folder: of the data set.
        features: of a frame.
    """

    def __init__(self, folder: Path, features: dict[str, dict[str, Any]]) -> None:
        self._folder, self._features = folder / "data", features
        self._writer: Any = None
        self._file = self._in_file = 0
        self.count = self.episodes = 0
        self.statistics = FrameStatistics()

    def add(self, values: dict[str, Array], task: int, fps: int) -> dict[str, Any]:
        """Write an episode; what LeRobot says of it."""
        length = len(values["action"])
        index = np.arange(length)
        own = {
            **values,
            "timestamp": (index / fps).astype(np.float32),
            "frame_index": index,
            "episode_index": np.full(length, self.episodes),
            "index": self.count + index,
            "task_index": np.full(length, task),
        }
        place = self._write(own, length)
        told = {
            "episode_index": self.episodes,
            "length": length,
            "data/chunk_index": place // FILES_PER_CHUNK,
            "data/file_index": place % FILES_PER_CHUNK,
            "dataset_from_index": self.count,
            "dataset_to_index": self.count + length,
            "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
            **self.statistics.add(own),
        }
        self.count, self.episodes = self.count + length, self.episodes + 1
        return told

    def _write(self, own: dict[str, Array], length: int) -> int:
        """Write a table of frames; the number of the file that it is in."""
        if self._in_file + length > FRAMES_PER_FILE and self._in_file:
            self.close()
            self._file, self._in_file = self._file + 1, 0
        pa = pyarrow()
        table = pa.table({key: self._array(key, own[key]) for key in self._features})
        if self._writer is None:
            place = {
                "chunk_index": self._file // FILES_PER_CHUNK,
                "file_index": self._file % FILES_PER_CHUNK,
            }
            path = self._folder / _PATH.format(**place)
            path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = parquet().ParquetWriter(path, table.schema)
        self._writer.write_table(table)
        self._in_file += length
        return self._file

    def _array(self, key: str, values: Array) -> Any:
        pa, (size,) = pyarrow(), self._features[key]["shape"]
        flat = pa.array(values.reshape(-1))
        return flat if size == 1 else pa.FixedSizeListArray.from_arrays(flat, size)

    def close(self) -> None:
        """Finish the file that is written to."""
        if self._writer is not None:
            self._writer.close()
        self._writer = None


def _write_meta(
    folder: Path,
    chosen: Selection,
    features: dict[str, Any],
    tasks: dict[str, int],
    told: list[dict[str, Any]],
    fps: int,
    frames: _Frames,
) -> None:
    meta = folder / "meta"
    episodes = meta / "episodes" / _PATH.format(chunk_index=0, file_index=0)
    episodes.parent.mkdir(parents=True)
    parquet().write_table(pyarrow().Table.from_pylist(told), episodes)
    index = _pandas().Index(list(tasks), name="task")
    _pandas().DataFrame({"task_index": list(tasks.values())}, index=index).to_parquet(
        meta / "tasks.parquet"
    )
    info = {
        "codebase_version": VERSION,
        "robot_type": chosen.env_id,
        "total_episodes": frames.episodes,
        "total_frames": frames.count,
        "total_tasks": len(tasks),
        "chunks_size": FILES_PER_CHUNK,
        "data_files_size_in_mb": FILE_MB,
        "video_files_size_in_mb": FILE_MB,
        "fps": fps,
        "splits": {"train": f"0:{frames.episodes}"},
        "data_path": f"data/{_PATH}",
        "video_path": None,
        "features": features,
    }
    write_json(meta / "info.json", info)
    write_json(meta / "stats.json", frames.statistics.total())
    said = {"columns": chosen.columns, "discretizations": chosen.discretizations()}
    write_json(meta / "integ_gym.json", said)
