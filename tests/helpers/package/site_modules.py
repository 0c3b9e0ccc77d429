"""Modules of the documentation site, which no package holds."""

from __future__ import annotations

import importlib.util
import sys
from types import ModuleType

from house import ROOT


def loaded(name: str) -> ModuleType:
    """A module of `docs/site`."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "docs" / "site" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module
