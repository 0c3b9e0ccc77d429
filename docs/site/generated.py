"""Pages that are made from what they are about: commands, public names, examples and notebooks."""

from __future__ import annotations

import base64
import importlib
import json
import os
import re
from collections.abc import Iterable, Iterator
from itertools import groupby
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

import integ_gym
from integ_gym.cli import COMMANDS
from integ_gym.envs.registries import PLANTS, TASKS
from integ_gym.evidence.fields import SUMMARY_FIELDS, Field, trace_fields

ROOT = Path(__file__).parents[2]
NOTEBOOKS = ROOT / "examples" / "notebooks"

API = {
    "environments": (
        "Environments",
        "What `gym.make` and `gym.make_vec` give, and what a discretization is.",
        (
            "ENVIRONMENTS", "IntegEnv", "IntegVectorEnv", "Discretization", "rediscretize",
            "IntegGymError",
            "functional",
        ),
    ),
    "catalogue": (
        "The environments",
        "Each one's contract: state, observation, action, rates, units, reward, arguments, `info`.",
        (),
    ),
    "training": (
        "Training",
        "Policies trained with stable-baselines3 or the fleet, and what their files say of them.",
        (
            "PPOConfig", "train_ppo", "SACConfig", "train_sac", "train_fleet", "TrainingEvidence",
            "Policy", "save_policy", "write_sidecar", "DiscretizationCallback",
            "discretization_gap",
        ),
    ),
    "judging": (
        "Judging",
        "Panels, policies that exist, and films.",
        ("evaluate", "check", "compare_contracts", "run_panel", "read_panel", "side_by_side"),
    ),
    "evidence": (
        "Evidence",
        "One record per episode: recorders, and the store that they write to.",
        ("EpisodeContext", "RecordEvidence", "RecordVectorEvidence", "EvidenceStore"),
    ),
    "own": (
        "Parts of your own",
        "What plants, integrators, tasks, engines and testbeds of your own are made of.",
        (
            "Plant", "parameter", "positive", "nonnegative", "ContactPoint", "ContactFrame",
            "Integrator", "Step", "along", "Task", "Command", "Engine", "Testbed",
            "GymTestbed", "MjcfTestbed", "Applied", "Success", "Boundaries",
        ),
    ),
    "numerics": (
        "Numerics",
        "What a one-step map does: fingerprints, orders, phase space, energy.",
        ("numerics",),
    ),
}  # fmt: skip
"""Page to its title, what it is about, and the public names on it."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are written nowhere else."""
    for uri, text in _pages():
        files.append(File.generated(config, uri, content=text))
    return files


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Leave out the menu beside the first page, which has one entry."""
    if page.file.src_uri == "index.md":
        page.meta["hide"] = ["navigation"]
    return markdown


def _pages() -> Iterator[tuple[str, str | bytes]]:
    yield "reference/commands.md", _commands()
    yield "reference/fields.md", _fields()
    for stem in API:
        yield f"reference/api/{stem}.md", _names(stem)
    yield "tutorials/examples.md", _examples()
    for path in sorted(NOTEBOOKS.glob("*.ipynb")):
        yield from _notebook(path)


def _fields() -> str:
    """Every field of a record, by group, and the columns of a trace."""
    task = TASKS.load("pendulum_swing_up")
    parts = [
        "# Fields of a record",
        "Every column of the evidence, as it is defined in `evidence/fields.py`: its type, SI unit "
        "and meaning. *Not hashed*: left out of `content_hash`.",
    ]
    for group, fields in groupby(SUMMARY_FIELDS, key=lambda field: field.group):
        parts.append(f"## {group.capitalize()}\n\n{_table(fields)}")
    trace = _table(trace_fields(PLANTS.load(task.plant), task))
    return "\n\n".join([*parts, f"## Trace of `IntegPendulum-v0`\n\n{trace}"]) + "\n"


def _table(fields: Iterable[Field]) -> str:
    rows = ["| field | type | unit | meaning |", "|---|---|---|---|"]
    for field in fields:
        about = ", ".join(filter(None, (field.kind, field.at, "not hashed" * field.volatile)))
        meaning = field.meaning.replace("|", "\\|")
        rows.append(f"| `{field.name}` | {about} | {field.unit or '–'} | {meaning} |")
    return "\n".join(rows)


def _names(stem: str) -> str:
    """A page of the reference of Python."""
    title, about, names = API[stem]
    parts = [f"# {title}", about]
    if stem == "catalogue":
        paths = [_environment(env_id) for env_id in integ_gym.ENVIRONMENTS]
    else:
        paths = [path for name in names for path in _paths(name)]
    return "\n\n".join([*parts, *map(_directive, paths)]) + "\n"


def _directive(path: str) -> str:
    """Options of mkdocstrings; a configuration is shown with the fields that it inherits."""
    whole = "\n    options:\n      inherited_members: true" if path.endswith("Config") else ""
    return f"::: {path}{whole}"


def _environment(env_id: str) -> str:
    """Path of an environment's class."""
    return integ_gym.ENVIRONMENTS[env_id].replace(":", ".") + "Env"


def _paths(name: str) -> list[str]:
    """Of a public name; of a module, of what it offers."""
    value = getattr(integ_gym, name)
    if not hasattr(value, "__path__"):
        return [f"integ_gym.{name}"]
    return [f"{value.__name__}.{inner}" for inner in value.__all__]


def _commands() -> str:
    """What every command says with ``--help``, as wide as a page of 1280 px shows it."""
    os.environ["COLUMNS"] = "78"
    parts = ["# Commands", "`integ-gym COMMAND --help`, of every command."]
    for name, command in COMMANDS.items():
        parser = importlib.import_module(f"integ_gym.commands.{name}").parser()
        shown = f"```text\n{parser.format_help().rstrip()}\n```"
        parts += [f"## {name}", f"{command.purpose[0].upper()}{command.purpose[1:]}.", shown]
    return "\n\n".join(parts) + "\n"


def _examples() -> str:
    parts = [
        "# Examples",
        "Scripts of at most 40 lines, in the folder `examples/` of the repository. Each runs as it "
        "stands; `--help` says what it takes.",
    ]
    for path in sorted((ROOT / "examples").glob("*.py")):
        source = path.read_text(encoding="utf-8")
        title = path.stem.replace("_", " ").capitalize()
        parts += [f"## {title}", f'```python title="examples/{path.name}"\n{source}```']
    return "\n\n".join(parts) + "\n"


def _notebook(path: Path) -> Iterator[tuple[str, str | bytes]]:
    """A notebook's page, and the pictures that its cells drew."""
    parts: list[str] = []
    question = ""
    for number, cell in enumerate(json.loads(path.read_text(encoding="utf-8"))["cells"]):
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
            question = "".join(re.findall(r"^#+ (.+)$", source, re.MULTILINE)[-1:]) or question
            continue
        parts.append(f"```python\n{source}\n```")
        for output in cell["outputs"]:
            text, picture = _shown(output)
            if picture:
                name = f"{path.stem}_{number}.png"
                yield f"tutorials/{name}", picture
                parts.append(f"![What came of: {question}]({name})")
            elif text:
                parts.append(f"```text\n{text.rstrip()}\n```")
    where = f"This page is `examples/notebooks/{path.name}`, as it was last run."
    yield f"tutorials/{path.stem}.md", "\n\n".join([*parts, "---", where]) + "\n"


def _shown(output: dict[str, Any]) -> tuple[str, bytes]:
    """Text of an output, and its picture if it is one."""
    data = output.get("data", {})
    text = "".join(output.get("text", data.get("text/plain", "")))
    picture = base64.b64decode("".join(data.get("image/png", "")))
    return text, picture
