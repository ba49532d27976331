"""Records of the learned light in an asset."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from lightwell.core.color import srgb_bytes
from lightwell.core.notebook import card, png_uri
from lightwell.graph.pictures import Fallback as Fallback
from lightwell.graph.pictures import Picture as Picture

if TYPE_CHECKING:
    from lightwell.graph import Graph

EXTENSION = "LIGHTWELL_neural_radiance"
# Versions of the extension's JSON (format/FORMAT.md): a file has the oldest that can say what is in it.
VERSION, VERSION_WITH_LAMPS_OR_SKY = 1, 2
# Kinds of variables that move parts of the scene.
MOVING = ("node", "clip")
# Kinds of variables that version 1 does not know.
NEWER = ("environment", *MOVING)


# Notebooks show the largest buffers of a field as pictures, so many pixels a side at most.
SHOWN_BUFFERS, BUFFER_SIDE = 3, 192


def buffer_picture(values: np.ndarray) -> np.ndarray:
    """Draw stored numbers: an image of light as it is, anything else as grey values around 0.

    Args:
        values: [...] numbers; [H, W, 3] is an image.

    Returns:
        [h, w, 3] uint8, ``BUFFER_SIDE`` pixels a side at most; what does not fit is left out.
    """
    scale = max(float(np.abs(values).max(initial=0)), 1e-30)
    if values.ndim == 3 and values.shape[-1] == 3:
        step = -(-max(values.shape[:2]) // BUFFER_SIDE)
        return srgb_bytes(values[::step, ::step] / scale)
    side = min(int(np.ceil(np.sqrt(values.size))), BUFFER_SIDE)
    grey = np.zeros(side * side)
    numbers = values.ravel()[: side * side]
    grey[: numbers.size] = numbers / scale
    return np.repeat(np.rint(127.5 + 127.5 * grey).astype(np.uint8).reshape(side, side, 1), 3, axis=2)


@dataclass(frozen=True)
class LampEntry:
    """A group of the scene's own lights as it is stored: it has a switch, a dimmer and a colour."""

    name: str
    """Unique in the file."""
    nodes: tuple[str, ...] = ()
    """Names of the nodes whose emission or light follows it."""
    intensity: float = 1.0
    """First position of the dimmer; 1 is the light as it was baked."""
    color: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """First colour, linear sRGB; multiplies that of the lights."""

    def json(self) -> dict[str, Any]:
        """Convert the group to the JSON of the extension.

        Returns:
            JSON object.
        """
        return {
            "name": self.name,
            "nodes": list(self.nodes),
            "intensity": self.intensity,
            "color": list(self.color),
        }


@dataclass(frozen=True)
class EnvironmentEntry:
    """What surrounds the scene as it is stored: light from all directions that stands still."""

    radiance: tuple[float, float, float]
    """Linear sRGB; multiplies the picture where there is one."""
    picture: Picture | None = None
    """Equirectangular logarithms (format/LIGHTWELL_neural_radiance.md): first row +Y, columns by atan2(z, x) from -π to
    π. None: all directions are alike."""
    lamp: int | None = None
    """Index of the lamp that it follows; None: it cannot be changed."""


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

    def __repr__(self) -> str:
        return f"<FieldEntry {self.name} ({self.role}): {self.graph!r}>"

    def rows(self) -> list[tuple[str, str]]:
        """Describe the field for tables.

        Returns:
            Name and text of each row.
        """
        graph = self.graph
        return [
            ("field", f"{self.name} ({self.role})"),
            ("inputs", ", ".join(f"{name} [{width}]" for name, width in graph.inputs.items())),
            ("size", f"{graph.nbytes / 1000:.0f} kB in {len(graph.buffers)} buffers"),
            ("cost per pixel", f"{graph.macs:,} MAC, {graph.fetches:,} table reads"),
        ]

    def _repr_html_(self) -> str:
        """The field's tables and weights as pictures, its inputs, size and cost, for notebooks."""
        largest = sorted(self.graph.buffers.items(), key=lambda item: -item[1].nbytes)[:SHOWN_BUFFERS]
        pictures = {name: png_uri(buffer_picture(buffer.values())) for name, buffer in largest}
        return card(f"{self.name} ({self.role})", self.rows()[1:], pictures=pictures)
