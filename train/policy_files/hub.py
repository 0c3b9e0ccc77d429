"""Files of policies on the Hugging Face Hub, through its library."""

from __future__ import annotations

import re
from pathlib import Path, PurePosixPath
from typing import Any, Final

from integ_gym.support.errors import InputError, translate_errors
from integ_gym.support.optional import load
from integ_gym.support.terminal import list_some

from .card import PolicyFileError
from .reading import POLICY_ENDINGS

HUB_SCHEME: Final = "hf://"

_SHOWN: Final = 8
"""Files of a repository that a sentence names, at most."""

_PLACE: Final = re.compile(
    r"hf://(?P<repo>[\w.-]+/[\w.-]+)(?:@(?P<revision>[^/]+))?(?:/(?P<file>.+))?"
)


def load_hub() -> Any:
    """The library of the Hugging Face Hub.

    Raises:
        ModuleNotFoundError: if it is not installed, with the command that installs it.
    """
    return load("huggingface_hub", "hub")


def is_on_hub(place: object) -> bool:
    """Whether this names a file on the Hub: ``hf://USER/REPO[@REVISION][/FILE]``."""
    return isinstance(place, str) and place.startswith(HUB_SCHEME)


def fetch_file(place: str) -> Path:
    """A file of a model on the Hub, in the library's cache, with those of the same name beside it.

    Args:
        place: ``hf://USER/REPO[@REVISION][/FILE]``. Without a file the only policy of the
            repository is meant, or that of its name.

    Raises:
        PolicyFileError: if there is none, or several, in one sentence that names them.
        ValueError: for another form, or what cannot be reached.
        ModuleNotFoundError: see :func:`load_hub`.
    """
    found = _PLACE.fullmatch(place)
    if found is None:
        raise InputError(f"expected hf://USER/REPO, or hf://USER/REPO/FILE, got {place!r}")
    hub, repo, revision = load_hub(), found["repo"], found["revision"]
    try:
        with translate_errors(f"cannot read {place}; check the network"):
            names = hub.HfApi().list_repo_files(repo, revision=revision)
            name = found["file"] or choose_policy(names, repo)
            if name not in names:
                raise PolicyFileError(
                    f"hf://{repo} has no file {name}; it has {list_some(names, _SHOWN)}"
                )
            wanted = [f"{name}*", str(PurePosixPath(name).with_suffix(".json"))]
            folder = hub.snapshot_download(repo, revision=revision, allow_patterns=wanted)
    except InputError as error:
        if not isinstance(error.__cause__, hub.errors.HfHubHTTPError):
            raise
        code = error.__cause__.response.status_code
        raise InputError(
            f"the Hub shows you no {place} (status {code}); check its name, or `hf auth login` for "
            "a private one"
        ) from None
    return Path(folder, name)


def choose_policy(names: list[str], repo: str) -> str:
    """The only policy of a repository's files, or of several that of the repository's name.

    Raises:
        PolicyFileError: otherwise.
    """
    policies = [name for name in names if PurePosixPath(name).suffix.lower() in POLICY_ENDINGS]
    own = [name for name in policies if PurePosixPath(name).stem == repo.partition("/")[2]]
    chosen = policies if len(policies) == 1 else own
    if len(chosen) == 1:
        return chosen[0]
    if not policies:
        raise PolicyFileError(f"hf://{repo} holds no policy; it has {list_some(names, _SHOWN)}")
    place, several = f"hf://{repo}", list_some(policies, _SHOWN)
    raise PolicyFileError(f"{place} holds several policies; give {place}/FILE of {several}")
