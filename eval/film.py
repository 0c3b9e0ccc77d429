"""Films: episodes side by side in several discretizations, on a screen or in a file."""

from __future__ import annotations

import contextlib
import math
import os
import subprocess
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from time import perf_counter
from types import SimpleNamespace
from typing import Any, TypeAlias, overload

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from integ_gym.envs.environment import environment_setup, is_integ_environment
from integ_gym.envs.plants.interface import state_names
from integ_gym.envs.registries import ENVIRONMENTS, TRUTH
from integ_gym.envs.rendering.canvas import load_pygame, open_screen
from integ_gym.envs.rendering.cockpit import Moment, Pane, Panes
from integ_gym.envs.rendering.plants import ROBOT
from integ_gym.envs.rendering.skeletons import Skeleton
from integ_gym.envs.settings import (
    DISCRETIZATION,
    NATIVE,
    Discretization,
    Setup,
    check_divides,
    unlike_names,
)
from integ_gym.envs.tasks.interface import to_public_order
from integ_gym.envs.testbeds.making import find_testbed
from integ_gym.envs.transition import LOSSES, control_columns
from integ_gym.evidence.record import EvidenceRecord
from integ_gym.evidence.schema import parse_field
from integ_gym.support.errors import InputError
from integ_gym.support.optional import load, require
from integ_gym.train.policy import Policy, start_acting

Asked: TypeAlias = Discretization | Mapping[str, Any] | str
"""A discretization; some of its parts; or its name, as panels write it."""

TRUE_NAMES = ("truth", "reference")


def parse_discretization(asked: Asked, like: Discretization, env_id: str) -> Discretization:
    """The discretization that is asked for.

    Args:
        asked: such as ``"explicit_euler"``, ``"explicit_euler dt=0.0125"``, ``"mujoco RK4"`` or
            ``"truth"``.
        like: has the step, the control period and the engine of what does not say its own.
        env_id: one of integ-gym's environments.

    Raises:
        ValueError: for what is no name of a discretization, and for a step that does not divide
            the control period.
    """
    if isinstance(asked, Discretization):
        return asked
    parts: dict[str, Any] = {} if isinstance(asked, str) else dict(asked)
    if isinstance(asked, str):
        words = asked.split()
        step = words.pop() if words and words[-1].startswith("dt=") else ""
        if len(words) in (1, 2):
            parts = dict(zip(("integrator", "engine"), reversed(words), strict=False))
        try:
            parts |= {"dt": float(step.removeprefix("dt="))} if step else {}
        except ValueError:
            raise InputError(f"dt must be a number of seconds, got {step!r} in {asked!r}") from None
    if "integrator" not in parts or not set(parts) <= set(DISCRETIZATION):
        raise InputError(
            f"a discretization is an integrator, and if need be its engine before it and dt=S "
            f"after it, such as 'explicit_euler dt=0.0125'; got {asked!r}"
        )
    if parts["integrator"] in TRUE_NAMES:
        truth = find_testbed(env_id, {}).truth(parts.get("control_period", like.control_period))
        assert truth is not None  # of our environments
        return truth
    cell = replace(like, **parts)
    if cell.dt > 0.0:
        check_divides("dt", cell.dt, "the control period", cell.control_period)
    return cell


def check_filmed(env_id: str) -> None:
    """Refuse an environment that there are no pictures of.

    Raises:
        ValueError: for any but integ-gym's own.
    """
    if is_integ_environment(env_id):
        return
    remedy = f"of a record of {env_id} `integ-gym evidence show` prints the numbers"
    if env_id in gym.registry:
        remedy = f'{env_id} has pictures of its own, see render_mode="rgb_array" of gymnasium.make'
    raise InputError(f"films show {', '.join(ENVIRONMENTS)}; {remedy}")


Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Episode:
    """An episode at its control instants.

    Attributes:
        setup: of its environment.
        times: since the start, s, shape (steps + 1,).
        states: true states, SI units, shape (steps + 1, n).
        controls: applied in the step that ends there, shape (steps + 1, controls); 0 at the start.
        energy: of the plant, J, shape (steps + 1,).
        work: of the motor until then, J, shape (steps + 1,).
        numerics: energy that numerical error put in until then, J; NaN where it is not known.
        losses: energy that damping, contact and the speed limit took out until then, J.
        success: whether it succeeds.
    """

    setup: Setup
    times: Array
    states: Array
    controls: Array
    energy: Array
    work: Array
    numerics: Array
    losses: Array
    success: bool

    @property
    def discretization(self) -> Discretization:
        """What it runs on."""
        return Discretization.of(self.setup)

    def ledger(self) -> dict[str, Array]:
        """Amounts of energy, J, shape (steps + 1,), the last of which is the sum of the others."""
        return {
            "start": np.full_like(self.energy, self.energy[0]),
            "motor": self.work,
            "numerics": self.numerics,
            "losses": -self.losses,
            "energy": self.energy,
        }

    def moment(self, time: float, shown: Iterable[str]) -> Moment:
        """What a film shows at a time; its end, where it has ended.

        Args:
            time: since the start, s.
            shown: names of the amounts of energy that are.
        """
        place = int(np.searchsorted(self.times, time + 1e-9, side="right")) - 1
        ledger = self.ledger()
        bars = {name: float(ledger[name][place]) for name in shown}
        return Moment(self.states[place], tuple(self.controls[place].tolist()), bars)


def play_episode(
    policy: Policy, env_id: str, arguments: Mapping[str, Any], seed: int | None, start: Any = None
) -> Episode:
    """A policy's episode in an environment.

    Args:
        policy: what acts.
        env_id: one of integ-gym's environments.
        arguments: of the environment.
        seed: of its reset.
        start: true state, in state order, SI units, shape (n,); None: the seed draws it.

    Raises:
        TypeError, ValueError: for arguments that cannot be.
    """
    env = gym.make(env_id, disable_env_checker=True, **arguments)
    own: Any = env.unwrapped
    observation, info = env.reset(seed=seed)
    if start is not None and not np.array_equal(own.state_components, start):
        state = to_public_order(own.setup.task, np.array(start))
        observation, info = env.reset(seed=seed, options={"state": state})
    states, infos, ended = [own.state_components], [info], False
    act = start_acting(policy)
    while not ended:
        action = act(observation[None])[0].reshape(env.action_space.shape)
        observation, _, terminated, truncated, info = env.step(action)
        states.append(own.state_components)
        infos.append(info)
        ended = terminated or truncated
    env.close()

    def column(name: str) -> Array:
        """Values of each step; NaN where they are not known."""
        values = [info.get(name) for info in infos]
        return np.array([np.nan if value is None else float(value) for value in values])

    return Episode(
        own.setup,
        column("time"),
        np.array(states),
        np.stack([column(name) for _, name in control_columns(own.setup.plant)], axis=1),
        column("energy"),
        np.cumsum(column("actuator_work")),
        np.cumsum(column("energy_residual")),
        sum((np.cumsum(column(name)) for name in LOSSES), np.zeros(len(infos))),
        bool(info["success"]),
    )


def episode_of_record(record: EvidenceRecord) -> Episode:
    """The episode of a record that has a trace.

    Raises:
        TypeError, ValueError: for arguments that cannot be any more.
    """
    setup = environment_setup(record["env_id"], record.arguments())
    trace = record.trace
    steps = len(trace["time"])

    def total(name: str) -> Array:
        return np.concatenate([[0.0], np.cumsum(trace[name])]) if name in trace else np.zeros(steps)

    return Episode(
        setup,
        trace["time"],
        np.stack([trace[name] for name in state_names(setup.plant)], axis=1),
        np.stack(
            [np.append(0.0, trace[f"{name}_applied"]) for name, _ in setup.plant.controls], axis=1
        ),
        trace["energy"],
        total("work"),
        total("energy_residual") if "energy_residual" in trace else np.full(steps, np.nan),
        sum((total(name) for name in LOSSES), np.zeros(steps)),
        bool(record["success"]),
    )


@dataclass(frozen=True)
class RobotEpisode(Episode):
    """A robot's episode: its states are joint positions, heading and the forces on its feet."""

    cell: Discretization

    @property
    def discretization(self) -> Discretization:
        """What it ran on."""
        return self.cell

    def ledger(self) -> dict[str, Array]:
        """Nothing: what contact takes is not known."""
        return {}


def skeleton_of(record: EvidenceRecord | Mapping[str, Any]) -> Mapping[str, Any] | None:
    """What a robot is drawn from; None of a record of no robot."""
    described = parse_field("engine_description", record["engine_description"]) or {}
    skeleton: Mapping[str, Any] | None = described.get("skeleton")
    return skeleton


def episode_of_robot(record: EvidenceRecord, described: Mapping[str, Any]) -> RobotEpisode:
    """The episode of a record that has a trace.

    Args:
        record: of a robot.
        described: see :func:`skeleton_of`.
    """
    trace, cell = record.trace, Discretization(**{name: record[name] for name in DISCRETIZATION})
    q = np.stack([trace[name] for name in described["coordinates"]], axis=1)
    skeleton = Skeleton(described, q[0])
    forces = [trace[f"{foot}_normal_force"] / described["weight"] for foot in described["feet"]]
    shares = np.vstack([np.zeros(len(forces)), np.reshape(forces, (len(forces), -1)).T])
    headings = skeleton.headings(q, round(0.5 / cell.control_period))
    nothing = np.zeros(len(q))
    return RobotEpisode(
        SimpleNamespace(plant=SimpleNamespace(name=ROBOT), skeleton=skeleton),  # type: ignore[arg-type]
        trace["time"],
        np.hstack([q, headings, shares]),
        nothing[:, None],
        *(nothing, nothing, nothing, nothing),
        success=bool(record["success"]),
        cell=cell,
    )


Frame = npt.NDArray[np.uint8]

FORMATS = (".gif", ".mp4")
HOLD = 2.5
"""How long the last frame stays, s."""
_COLOURS = 64
_RATE_FACTOR = 20
"""Of H.264: 0 loses nothing, 51 most."""
_SAMPLES = 5
"""Frames that the palette of a GIF is made from."""


def check_writable(path: Path) -> None:
    """Refuse what a film cannot be written to, before anything is run.

    Raises:
        ValueError: for another ending than a film's.
        OSError: if its folder is not there, or it is one itself.
        ModuleNotFoundError: if the extra is missing, with the command that installs it.
    """
    if path.suffix.lower() not in FORMATS:
        raise InputError(f"a film is written as {' or '.join(FORMATS)}, got {path.name!r}")
    require("render")
    if path.is_dir():
        raise IsADirectoryError(f"{path} is a folder; give another path for the film")
    if not path.resolve().parent.is_dir():
        raise FileNotFoundError(
            f"there is no folder {path.parent}; make it, or give another path for the film"
        )


def write_film(frames: Sequence[Frame], fps: int, path: Path) -> Path:
    """Write frames, the last of which stays for a while; the file is replaced in one step.

    Args:
        frames: each of shape (height, width, 3).
        fps: frames per second.
        path: ends in ``.gif`` or ``.mp4``.

    Raises:
        ValueError, OSError, ModuleNotFoundError: see :func:`check_writable`.
    """
    check_writable(path)
    part = path.with_name(f".{path.stem}.part{path.suffix.lower()}")
    try:
        {".gif": _write_gif, ".mp4": _write_mp4}[part.suffix](frames, fps, part)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
    return path


def _write_gif(frames: Sequence[Frame], fps: int, path: Path) -> None:
    """With one palette for all frames, so that what stands still costs nothing."""
    images = load("PIL.Image", "render")
    places = np.linspace(0, len(frames) - 1, min(_SAMPLES, len(frames))).round().astype(int)
    sample = images.fromarray(np.concatenate([frames[int(k)] for k in places]))
    palette = sample.quantize(_COLOURS, dither=images.Dither.NONE)
    drawn: Iterator[Any] = (
        images.fromarray(frame).quantize(palette=palette, dither=images.Dither.NONE)
        for frame in frames
    )
    times = [round(1000 / fps)] * (len(frames) - 1) + [round(1000 * HOLD)]
    next(drawn).save(path, save_all=True, append_images=drawn, duration=times, loop=0)


def _write_mp4(frames: Sequence[Frame], fps: int, path: Path) -> None:
    """H.264 with pixels that every player shows, which takes even sizes."""
    height, width = (n - n % 2 for n in frames[0].shape[:2])
    given = f"-f rawvideo -pix_fmt rgb24 -s {width}x{height} -r {fps} -i -".split()
    wanted = f"-c:v libx264 -pix_fmt yuv420p -crf {_RATE_FACTOR}".split()
    program = load("imageio_ffmpeg", "render").get_ffmpeg_exe()
    command = [program, "-loglevel", "error", "-y", *given, *wanted, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stderr is not None
        with contextlib.suppress(BrokenPipeError):
            for frame in frames:
                process.stdin.write(frame[:height, :width].tobytes())
            for _ in range(round(HOLD * fps)):
                process.stdin.write(frame[:height, :width].tobytes())
            process.stdin.close()
        complaint = process.stderr.read().decode(errors="replace").strip()
    if process.returncode:
        raise OSError(f"cannot write {path.name}: {complaint or 'ffmpeg failed'}")


FPS = 20
"""Frames per second: the times between them are whole hundredths, which a GIF keeps."""


LEAST_START = 0.05
"""Energy at the start below which it is not shown, J."""


class Film(Sequence[Frame]):
    """Frames of one policy's episodes side by side, in real time; each is drawn when asked for.

    Attributes:
        episodes: from left to right.
        fps: frames per second.

    Args:
        episodes: of one plant.
        trained_on: what the policy was trained on; empty where that is not known.
        note: what all of them have in common, in words.
    """

    fps = FPS

    def __init__(
        self, episodes: Sequence[Episode], trained_on: Sequence[Discretization] = (), note: str = ""
    ) -> None:
        self.episodes = tuple(episodes)
        self._trained_on = tuple(trained_on)
        self._note = note

    @property
    def success(self) -> dict[str, bool]:
        """Whether the policy succeeds, by the name of the discretization."""
        names = unlike_names([episode.discretization for episode in self.episodes])
        return dict(zip(names, (episode.success for episode in self.episodes), strict=True))

    @property
    def seconds(self) -> float:
        """How long the longest episode lasts, s."""
        return max(float(episode.times[-1]) for episode in self.episodes)

    def __len__(self) -> int:
        return math.floor(self.seconds * self.fps + 1e-6) + 1

    @overload
    def __getitem__(self, place: int) -> Frame: ...

    @overload
    def __getitem__(self, place: slice) -> list[Frame]: ...

    def __getitem__(self, place: int | slice) -> Frame | list[Frame]:
        """One frame, shape (height, width, 3); or a list of them for a slice."""
        if isinstance(place, slice):
            return [self[k] for k in range(*place.indices(len(self)))]
        if not -len(self) <= place < len(self):
            raise IndexError(f"the film has {len(self)} frames; there is no frame {place}")
        time = place % len(self) / self.fps
        moments = [episode.moment(time, self._shown) for episode in self.episodes]
        return self._panes.draw(moments, time)

    def write(self, path: str | os.PathLike[str]) -> Path:
        """Write it as ``.gif`` or ``.mp4``, by the path's ending.

        Raises:
            ValueError: for another ending.
            OSError: if the file cannot be written.
            ModuleNotFoundError: if an extra is missing, with the command that installs it.
        """
        return write_film(self, self.fps, Path(path))

    @cached_property
    def _shown(self) -> tuple[str, ...]:
        """Names of the amounts of energy that are shown: a start at rest and no losses are not."""
        ledgers = [episode.ledger() for episode in self.episodes]
        least = {"start": LEAST_START, "losses": 0.0}
        return tuple(
            name
            for name in ledgers[0]
            if name not in least or any(np.abs(own[name]).max() > least[name] for own in ledgers)
        )

    @cached_property
    def _panes(self) -> Panes:
        panes = [
            Pane(episode.setup, *self._titles(episode.discretization), episode.success)
            for episode in self.episodes
        ]
        ledgers = [episode.ledger() for episode in self.episodes]
        amounts = np.concatenate(
            [np.zeros(1), *(own[name] for own in ledgers for name in self._shown)]
        )
        reach = float(np.nanmin(amounts)), float(np.nanmax(amounts))
        return Panes(panes, self._heading(), self._note, len(self._shown), reach)

    def _heading(self) -> str:
        cells = [episode.discretization for episode in self.episodes]
        if len(set(cells)) == 1:
            return "One policy, one start"
        same_engine = len({cell.engine for cell in cells}) == 1
        same_step = len({cell.dt for cell in cells if cell.integrator != TRUTH}) == 1
        what = "integrator" if same_engine and same_step else "discretization"
        return f"Same policy, same start. Only the {what} differs."

    def _titles(self, cell: Discretization) -> tuple[str, str]:
        """Name of a discretization, and what there is to know of it."""
        periods = {episode.discretization.control_period for episode in self.episodes}
        own = f"a decision every {cell.control_period:g} s" if len(periods) > 1 else ""
        trained = "trained here" if cell in self._trained_on else ""
        if cell.integrator == TRUTH:
            return "truth", ", ".join(filter(None, ("solved to rounding", own, trained)))
        name = cell.integrator.rpartition(":")[2].replace("_", " ")
        engine = "" if cell.engine == NATIVE else f"{cell.engine.rpartition(':')[2]} "
        return engine + name, ", ".join(filter(None, (f"dt {cell.dt:g} s", own, trained)))


_PAUSE = 1.5
"""How long the last frame stays before the film begins again, s."""


def show_film(film: Film) -> None:
    """Show a film until its window is closed, or Escape or Q is pressed.

    Raises:
        ValueError: where there is no display, with the remedy.
    """
    pygame = load_pygame()
    frames = [pygame.surfarray.make_surface(frame.swapaxes(0, 1)) for frame in film]
    try:
        screen = open_screen(frames[0].get_size(), "integ-gym watch")
    except ValueError as error:
        raise InputError(f"{error}; write the film with --out film.gif or film.mp4") from None
    began, is_open = perf_counter(), True
    while is_open:
        passed = (perf_counter() - began) % (len(frames) / film.fps + _PAUSE)
        screen.blit(frames[min(len(frames) - 1, int(passed * film.fps))], (0, 0))
        pygame.display.flip()
        pygame.time.wait(1000 // (2 * film.fps))
        is_open = not any(
            event.type == pygame.QUIT
            or (event.type == pygame.KEYDOWN and event.key in (pygame.K_ESCAPE, pygame.K_q))
            for event in pygame.event.get()
        )
    pygame.display.quit()
