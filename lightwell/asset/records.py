"""Records of the learned light in an asset."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from lightwell.graph.pictures import Fallback as Fallback
from lightwell.graph.pictures import Picture as Picture

if TYPE_CHECKING:
    from lightwell.graph import Graph

EXTENSION = "LIGHTWELL_neural_radiance"
# Version of the extension's JSON (format/FORMAT.md).
VERSION = 1


@dataclass(frozen=True)
class FieldEntry:
    """A baked field as it is stored in a glTF file."""

    name: str
    """Unique in the file."""
    role: Literal["indirect", "static"]
    """'indirect': light that depends on a variable; 'static': the light of the scene's fixed emitters."""
    graph: Graph
    """Shading graph with its buffers; its output ``radiance`` has width 3."""
    variable: int | None = None
    """Index of the variable that an indirect field depends on; None for a static one."""
    pictures: Mapping[str, Picture] = field(default_factory=dict)
    """Buffers, uint8 [H, W, 3] with the scale 1/255, that are stored as the red, green and blue of a picture."""
