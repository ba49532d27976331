"""Writes what game engines can take of a bake: light maps, probes, shader texts (docs/export.md)."""

from lightwell.engines.exporting import ENGINES as ENGINES
from lightwell.engines.exporting import export_engine as export_engine
