"""Cards of a run for the Hugging Face Hub, and the push."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from integ_gym.support.errors import InputError, translate_errors
from integ_gym.support.files import replace_file
from integ_gym.support.optional import package_version
from integ_gym.train.policy_files.hub import load_hub
from integ_gym.train.policy_files.reading import POLICY_ENDINGS

from .panel.result import FILE_NAME, Panel, read_panel
from .report.page import FILE_NAME as PAGE

KINDS: Final = {"model": "policies", "dataset": "."}
"""Kind of a repository to the folder of a run that it holds; a data set holds the whole run."""

_TAGS: Final = ["integ-gym", "reinforcement-learning", "gymnasium", "simulation", "reproducibility"]


def write_cards(run: Path, out: Path, repo: str) -> dict[str, Path]:
    """Write ``model.md`` and ``dataset.md``: the answer, the matrix, how to use it, and its limits.

    Args:
        run: directory of a finished panel or evaluation.
        out: folder for the cards.
        repo: ``USER/NAME`` of both repositories, for the commands in them.

    Returns:
        Kind of repository to its card.

    Raises:
        ValueError: if there is no finished run, or ``repo`` is of another form.
        ModuleNotFoundError: if the library is not installed, with the command that installs it.
    """
    if not (run / FILE_NAME).exists():
        raise InputError(
            f"{run} holds no finished panel; give a directory of `integ-gym panel` or `evaluate`"
        )
    if repo.count("/") != 1 or repo != repo.strip("/ "):
        raise InputError(f"--repo is USER/NAME, got {repo!r}")
    panel = read_panel(run / FILE_NAME)
    return {
        kind: replace_file(out / f"{kind}.md", _card(kind, panel, run, repo).encode())
        for kind in KINDS
    }


def push(run: Path, cards: dict[str, Path], repo: str, private: bool = False) -> list[str]:
    """Push policies with the model card, and the whole run with the dataset card.

    Returns:
        Address of each repository.

    Raises:
        ValueError: without a token, or if the Hub refuses.
    """
    hub = load_hub()
    if hub.get_token() is None:
        raise InputError(
            "there is no token of the Hugging Face Hub; run `hf auth login` or set HF_TOKEN, then "
            "give the command again"
        )
    api, places = hub.HfApi(), []
    for kind, folder in KINDS.items():
        files = {"README.md": cards[kind], **_files(run, folder)}
        with translate_errors(f"the Hub did not take the {kind} {repo}; check its name and token"):
            place = api.create_repo(repo, repo_type=kind, private=private or None, exist_ok=True)
            api.create_commit(
                repo,
                [hub.CommitOperationAdd(name, str(path)) for name, path in files.items()],
                commit_message=f"integ-gym {package_version('integ-gym')}: {run.resolve().name}",
                repo_type=kind,
            )
        places.append(str(place))
    return places


def _files(run: Path, folder: str) -> dict[str, Path]:
    """What a repository holds beside its card, by name."""
    own = [path for path in sorted((run / folder).rglob("*")) if path.is_file()]
    shared = [run / name for name in (FILE_NAME, PAGE) if (run / name).exists()]
    return {path.relative_to(run).as_posix(): path for path in dict.fromkeys((*own, *shared))}


def _card(kind: str, panel: Panel, run: Path, repo: str) -> str:
    env_id = str(panel.spec["env_id"])
    yardsticks = [
        words
        for one, words in zip((panel.truth, panel.limit), _YARDSTICKS, strict=True)
        if one is not None
    ]
    parts = [
        f"---\n{_metadata(kind, panel, env_id, repo)}\n---",
        f"# {panel.question or panel.name}",
        f"**{panel.headline}**",
        "\n".join(f"- {line}" for line in panel.answer.splitlines()[1:]),
        f"Success on `{env_id}`, with its 95 % interval. A row is what policies were trained on, a "
        f"column what they were judged on{''.join(yardsticks)}.",
        "\n".join(_matrix(panel)),
        "## How to use it",
        *_uses(kind, run, env_id, repo),
        "## Limits",
        "\n".join(f"- {line}" for line in (*panel.warnings, *_LIMITS)),
        f"Made by integ-gym {panel.versions.get('integ-gym', '')} with",
        f"```sh\n{panel.command}\n```",
    ]
    return "\n\n".join(filter(None, parts)) + "\n"


_YARDSTICKS: Final = (
    "; the truth is the exact solution of the model",
    "; the limit is what the model's outcomes tend to as the step shrinks",
)

_LIMITS: Final = (
    "What is judged is a model, not the world: nothing is said of a real robot.",
    "Losses of other tasks, hyperparameters and training times may differ.",
)


def _metadata(kind: str, panel: Panel, env_id: str, repo: str) -> str:
    hub = load_hub()
    if kind == "dataset":
        files = [{"config_name": "default", "data_files": "evidence/**/*.parquet"}]
        return str(hub.DatasetCardData(tags=_TAGS, pretty_name=panel.name, configs=files).to_yaml())
    results = [
        hub.EvalResult(
            task_type="reinforcement-learning",
            dataset_type=env_id,
            dataset_name=f"{env_id}: {panel.in_words(entry.cell)}",
            metric_type="success_rate",
            metric_name=f"success of {row.name}",
            metric_value=round(entry.success.estimate, 4),
        )
        for row in panel.ordered_rows
        if not row.baseline and (entry := panel.on_yardstick(row.name))
    ]
    named: dict[str, Any] = {"model_name": repo, "eval_results": results} if results else {}
    return str(hub.ModelCardData(library_name="integ-gym", tags=_TAGS, **named).to_yaml())


def _matrix(panel: Panel) -> Iterator[str]:
    """Lines of a table of success, rows by columns."""
    columns = panel.columns
    yield "| | " + " | ".join(panel.label(cell.name) for cell in columns) + " |"
    yield "|---" * (len(columns) + 1) + "|"
    for row in panel.ordered_rows:
        entries = [panel.entry(row.name, cell.name) for cell in columns]
        cells = [str(entry.success) if entry else "–" for entry in entries]
        yield f"| {panel.label(row.name)} | " + " | ".join(cells) + " |"


def _uses(kind: str, run: Path, env_id: str, repo: str) -> Iterator[str]:
    if kind == "model":
        file = next((name for name in _files(run, "policies") if name.endswith(POLICY_ENDINGS)), "")
        yield (
            "```sh\npip install 'integ-gym[report,hub]'\n"
            f"integ-gym evaluate hf://{repo}/{file} --env {env_id} --out judged\n```"
        )
    else:
        yield (
            "This is the whole run. Each row of `evidence` is an episode, and `panel.json` is "
            "computed from them:\n\n```sh\npip install 'integ-gym[report,hub]'\n"
            f"hf download {repo} --repo-type dataset --local-dir run\n"
            "integ-gym evidence verify run\n```"
        )
