"""The panel's specification: read from TOML, checked, expanded into rows and cells."""

from .panel_spec import PanelSpec
from .reading import built_in_spec, parse_spec, read_spec
from .values import SpecError

__all__ = ["PanelSpec", "SpecError", "built_in_spec", "parse_spec", "read_spec"]
