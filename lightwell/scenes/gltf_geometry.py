"""Primitives of a glTF file as arrays in the mesh's own space. V vertices, T triangles."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.scenes.gltf_accessors import Accessors, as_floats
from lightwell.scenes.gltf_container import Document
from lightwell.scenes.gltf_json import Place

MODES = {0: "points", 1: "lines", 2: "line loops", 3: "line strips"}
TRIANGLES, STRIP, FAN = 4, 5, 6
DRACO = "KHR_draco_mesh_compression"
# Attributes that are read, and how many components they may have.
ATTRIBUTES = {
    "POSITION": (3,),
    "NORMAL": (3,),
    "TEXCOORD_0": (2,),
    "TEXCOORD_1": (2,),
    "COLOR_0": (3, 4),
    "JOINTS_0": (4,),
    "WEIGHTS_0": (4,),
    "JOINTS_1": (4,),
    "WEIGHTS_1": (4,),
}

# Replacement of values that are not finite, and its name in warnings; other attributes are refused.
REPAIRS = {
    "NORMAL": (0.0, "those of the triangles"),
    "TEXCOORD_0": (0.0, "zeros"),
    "TEXCOORD_1": (0.0, "zeros"),
    "COLOR_0": (1.0, "ones"),
}
# Vertex colours above this are not rounded ones: a surface would reflect more light than arrives.
MOST_COLOR = 1.001
# Attributes that are ignored without a warning: tangents are computed from texture coordinates.
SILENT_ATTRIBUTES = ("TANGENT",)


@dataclass(frozen=True)
class Primitive:
    """Triangles of one material in the space of their mesh."""

    positions: np.ndarray
    """[V, 3] float32."""
    indices: np.ndarray
    """[T, 3] uint32."""
    normals: np.ndarray | None
    uv0: np.ndarray | None
    uv1: np.ndarray | None
    colors: np.ndarray | None
    """[V, 4] float32 linear."""
    material: int | None
    """Index into the file's materials."""
    joints: np.ndarray | None = None
    """[V, 4 or 8] whole numbers, indices into the skin's joints."""
    weights: np.ndarray | None = None
    """[V, 4 or 8] float32."""


class Geometry:
    """Reads each primitive once, however many nodes place it."""

    def __init__(self, document: Document, accessors: Accessors, warn: Callable[[str], None]) -> None:
        """Prepare the reading of one file.

        Args:
            document: The file.
            accessors: Its accessors.
            warn: Called with each element that is ignored or repaired.
        """
        self._document, self._accessors, self._warn = document, accessors, warn
        self._meshes: dict[tuple[int, tuple[float, ...]], list[Primitive]] = {}
        self.ignored: set[str] = set()
        """Names of attributes that were ignored."""

    def mesh(self, index: int, weights: Sequence[float] | None = None) -> list[Primitive]:
        """Read the triangle primitives of a mesh.

        Args:
            index: Number of the mesh.
            weights: Those of its morph targets; None: those of the mesh.

        Returns:
            Its primitives.
        """
        place = self._document.item("meshes", index)
        key = index, tuple(weights if weights is not None else morph_weights(place) or ())
        if key not in self._meshes:
            place.what = f"mesh {index}"
            found = [
                self._primitive(Place(place.scene, f"mesh {index} primitive {i}", value), key[1])
                for i, value in enumerate(place.items("primitives"))
            ]
            self._meshes[key] = [primitive for primitive in found if primitive is not None]
        return self._meshes[key]

    def _primitive(self, place: Place, weights: Sequence[float]) -> Primitive | None:
        mode = place.integer("mode", TRIANGLES)
        if mode in MODES:
            self._warn(f"{place.what}: {MODES[mode]} are skipped, only triangles are loaded")
            return None
        if mode not in (TRIANGLES, STRIP, FAN):
            place.fail(f"has mode {mode}, expected 0..6")
        attributes = place.place("attributes")
        names = attributes.value if attributes else ()
        self.ignored.update(name for name in names if name not in ATTRIBUTES and name not in SILENT_ATTRIBUTES)
        draco = place.extension(DRACO)
        arrays, corners = self._draco(place, draco) if draco else self._plain(place)
        if "POSITION" not in arrays:
            self._warn(f"{place.what}: has no positions and is skipped")
            return None
        if "targets" in place:
            self._morph(place, arrays, weights)
        return self._checked(place, arrays, triangles(corners, mode if draco is None else TRIANGLES))

    def _plain(self, place: Place) -> tuple[dict[str, np.ndarray], np.ndarray]:
        attributes = place.need("attributes")
        arrays = {}
        for name in ATTRIBUTES:
            number = attributes.index(name, self._document.count("accessors"), "accessor")
            if number is not None:
                # Colours of whole numbers are normalized, also where an exporter forgot to say so (glTF 2.0, 3.7.2.1).
                values = self._accessors.read(number) if name == "COLOR_0" else self._accessors.floats(number)
                arrays[name] = as_floats(values, name == "COLOR_0")
        number = place.index("indices", self._document.count("accessors"), "accessor")
        if number is not None:
            corners = self._accessors.read(number)
            if corners.dtype.kind != "u" or corners.shape[1] != 1:
                place.fail(f"has indices in accessor {number} that are not unsigned whole numbers")
            return arrays, corners[:, 0].astype(np.uint32)
        return arrays, np.arange(len(arrays.get("POSITION", ())), dtype=np.uint32)

    def _morph(self, place: Place, arrays: dict[str, np.ndarray], weights: Sequence[float]) -> None:
        """Move positions and normals by the morph targets whose weight is not 0."""
        targets = place.items("targets")
        used = [(float(w), i) for i, w in enumerate(weights[: len(targets)]) if w != 0]
        self._warn(f"{place.what}: morph targets are {'kept as they are at rest' if used else 'ignored'}")
        for weight, i in used:
            self._document.budget.check_time(place.what)
            target = Place(place.scene, f"{place.what} target {i}", targets[i])
            for name in ("POSITION", "NORMAL"):
                number = target.index(name, self._document.count("accessors"), "accessor")
                if number is None or name not in arrays:
                    continue
                step = self._accessors.floats(number)
                if step.shape != arrays[name].shape:
                    target.fail(f"has {name} of shape {list(step.shape)}, expected {list(arrays[name].shape)}")
                arrays[name] = arrays[name] + np.float32(weight) * step

    def _repaired(self, place: Place, name: str, values: np.ndarray) -> np.ndarray:
        """Replace values that are not finite; a normal of length 0 later becomes that of the triangles."""
        bad = ~np.isfinite(values).all(axis=1)
        if name not in REPAIRS:
            place.fail(f"has {name} that are not finite numbers", "repair the mesh and export it again")
        replacement, called = REPAIRS[name]
        self._warn(f"{place.what}: {int(bad.sum())} of {len(bad)} {name} are not finite numbers; {called} are used")
        return np.where(bad[:, None], np.float32(replacement), values)

    def _draco(self, place: Place, draco: Place) -> tuple[dict[str, np.ndarray], np.ndarray]:
        import DracoPy

        number = draco.index("bufferView", self._document.count("bufferViews"), "bufferView")
        if number is None:
            draco.fail("has no bufferView")
        try:
            mesh = DracoPy.decode(bytes(self._accessors.view(number, draco)))
            faces = np.asarray(mesh.faces, np.uint32).reshape(-1)
        except Exception as error:  # the decoder raises many types for a damaged buffer
            if isinstance(error, (KeyboardInterrupt, SystemExit)):
                raise
            draco.fail(f"cannot be decompressed ({str(error).splitlines()[0] if str(error) else type(error).__name__})")
        ids, attributes = draco.need("attributes"), place.need("attributes")
        arrays = {}
        for name in ATTRIBUTES:
            if name in ids:
                arrays[name] = self._draco_attribute(mesh, ids, attributes, name)
        # Copies are charged by what the accessors say.
        self._compare(attributes, "POSITION", len(arrays.get("POSITION", ())))
        self._compare(place, "indices", len(faces))
        return arrays, faces

    def _compare(self, place: Place, key: str, found: int) -> None:
        """Refuse compressed data that hold more elements than their accessor says."""
        number = place.index(key, self._document.count("accessors"), "accessor")
        said = None if number is None else self._document.item("accessors", number).integer("count", low=1)
        if said is not None and found > said:
            place.fail(f"has {found} {key} in its compressed data, but accessor {number} says {said}")

    def _draco_attribute(self, mesh: Any, ids: Place, attributes: Place, name: str) -> np.ndarray:
        wanted = ids.integer(name)
        found = mesh.get_attribute_by_unique_id(wanted)
        values = None if found is None else np.asarray(found["data"])
        if values is None or values.ndim != 2:
            ids.fail(f"names attribute {wanted} for {name}, which the compressed data lacks")
        number = attributes.index(name, self._document.count("accessors"), "accessor")
        normalized = number is not None and self._document.item("accessors", number).flag("normalized")
        return as_floats(values, normalized or name == "COLOR_0")

    def _checked(self, place: Place, arrays: dict[str, np.ndarray], indices: np.ndarray) -> Primitive:
        positions = arrays["POSITION"]
        count = len(positions)
        for name, values in list(arrays.items()):
            if len(values) != count or values.shape[1] not in ATTRIBUTES[name]:
                wanted = " or ".join(map(str, ATTRIBUTES[name]))
                place.fail(f"has {name} of shape {list(values.shape)}, expected [{count}, {wanted}]")
            if not np.isfinite(values).all():
                arrays[name] = self._repaired(place, name, values)
        if indices.size and int(indices.max()) >= count:
            place.fail(f"names vertex {int(indices.max())}, but has {count}")
        material = place.index("material", self._document.count("materials"), "material")
        colors = arrays.get("COLOR_0")
        if colors is not None and (colors.min() < 0 or colors.max() > MOST_COLOR):
            self._warn(f"{place.what}: has COLOR_0 outside of 0 to 1; they are cut")
            colors = colors.clip(0, 1)
        if colors is not None and colors.shape[1] == 3:
            colors = np.concatenate([colors, np.ones((count, 1), np.float32)], axis=1)
        normals, uv0, uv1 = (arrays.get(n) for n in ("NORMAL", "TEXCOORD_0", "TEXCOORD_1"))
        joints, weights = _influences(arrays)
        return Primitive(positions, indices, normals, uv0, uv1, colors, material, joints, weights)


def _influences(arrays: dict[str, np.ndarray]) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Joints and weights of a skin: four or eight of each vertex."""
    joints, weights = arrays.get("JOINTS_0"), arrays.get("WEIGHTS_0")
    more, heavy = arrays.get("JOINTS_1"), arrays.get("WEIGHTS_1")
    if joints is None or weights is None or more is None or heavy is None or not heavy.any():
        return joints, weights
    return np.concatenate([joints, more], axis=1), np.concatenate([weights, heavy], axis=1)


def morph_weights(place: Place) -> tuple[float, ...] | None:
    """Read the weights of morph targets that a mesh or a node has at rest.

    Args:
        place: Mesh or node.

    Returns:
        The weights; None where it has none.
    """
    return place.numbers("weights", len(place.items("weights"))) if "weights" in place else None


def triangles(corners: np.ndarray, mode: int) -> np.ndarray:
    """Convert a vertex list to triangles.

    Args:
        corners: [K] vertex numbers.
        mode: glTF mode TRIANGLES, STRIP or FAN.

    Returns:
        [T, 3] uint32.
    """
    if mode == TRIANGLES:
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    count = max(len(corners) - 2, 0)
    first = np.arange(count)
    if mode == FAN:
        return np.stack([corners[first + 1], corners[first + 2], np.broadcast_to(corners[:1], count)], axis=-1)
    odd = first % 2
    return np.stack([corners[first], corners[first + 1 + odd], corners[first + 2 - odd]], axis=-1)
