"""Optional packages, checked before any work is done."""

from __future__ import annotations

from importlib.util import find_spec

EXTRAS = {
    "train": ("stable_baselines3", "torch", "scipy", "tqdm", "threadpoolctl"),
    "report": ("jinja2", "matplotlib"),
    "evidence": ("pyarrow", "duckdb"),
}
"""Extra to the modules that it brings."""


def require(*extras: str) -> None:
    """Check that the modules of some extras are installed.

    Raises:
        ModuleNotFoundError: in one line, with the command that installs what is missing.
    """
    missing = {name: m for name in extras for m in EXTRAS[name] if find_spec(m) is None}
    if missing:
        modules, names = ", ".join(sorted(missing.values())), ",".join(sorted(missing))
        raise ModuleNotFoundError(
            f'{modules} is not installed; run: pip install "integ-gym[{names}]"'
        )
