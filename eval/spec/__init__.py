"""The panel's specification: read from TOML, checked, expanded into rows and cells."""

from integ_gym.eval.spec.panel_spec import PanelSpec
from integ_gym.eval.spec.reading import built_in_spec, parse_spec, read_spec
from integ_gym.eval.spec.values import SpecError

__all__ = ["PanelSpec", "SpecError", "built_in_spec", "parse_spec", "read_spec"]
