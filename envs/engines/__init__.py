"""Engines: one module each, found by name."""

from integ_gym.support import Registry
from integ_gym.support import absent

ENGINES = Registry(__name__, "engine", "advance")


def missing_modules(engine: str) -> list[str]:
    """Modules that an engine needs and that are not installed; its extra brings them."""
    return absent(getattr(ENGINES.load(engine), "modules", ()))
