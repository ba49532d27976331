"""Accessors of a glTF file as NumPy arrays: strides, sparse values, normalized integers, meshopt compression."""

from __future__ import annotations

import numpy as np

from lightwell.scenes.gltf_container import Document
from lightwell.scenes.gltf_json import Place

COMPONENT_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")

# Filters of EXT_meshopt_compression and the element sizes that each is defined for.
MESHOPT_FILTERS = {
    "NONE": tuple(range(1, 257)),
    "OCTAHEDRAL": (4, 8),
    "QUATERNION": (8,),
    "EXPONENTIAL": tuple(range(4, 257, 4)),
}


class Accessors:
    """Reads accessors by index; decompressed buffer views are kept. A defect raises ``SceneError``."""

    def __init__(self, document: Document) -> None:
        """Prepare the reading of one file.

        Args:
            document: The file.
        """
        self._document = document
        self._unpacked: dict[int, bytes] = {}
        self._arrays: dict[int, np.ndarray] = {}

    def view(self, index: int, reader: Place) -> bytes | memoryview:
        """Return the bytes of a buffer view, decompressed.

        Args:
            index: Number of the buffer view.
            reader: Element that refers to it.

        Returns:
            Its bytes.
        """
        if index in self._unpacked:
            return self._unpacked[index]
        place = self._document.item("bufferViews", index)
        place.what = f"bufferView {index}"
        for name in MESHOPT:
            if (packed := place.extension(name)) is not None:
                self._unpacked[index] = self._meshopt(packed)
                return self._unpacked[index]
        return self._range(place, place)

    def stride(self, index: int) -> int | None:
        """Return the declared stride of a buffer view.

        Args:
            index: Number of the buffer view.

        Returns:
            Bytes between elements, or None.
        """
        place = self._document.item("bufferViews", index)
        return place.integer("byteStride", low=1, high=256) if "byteStride" in place else None

    def read(self, index: int) -> np.ndarray:
        """Read an accessor in its own type; the same array is returned each time and must not be changed.

        Args:
            index: Number of the accessor.

        Returns:
            [count, width] values.
        """
        if index not in self._arrays:
            self._arrays[index] = self._read(index)
        return self._arrays[index]

    def count(self, index: int) -> int:
        """Return the declared number of elements of an accessor.

        Args:
            index: Number of the accessor.

        Returns:
            Number of elements, ≥ 1.
        """
        return self._place(index).integer("count", low=1)

    def _read(self, index: int) -> np.ndarray:
        place = self._place(index)
        dtype, width, count = self.layout(place)
        self._document.budget.charge("decoded_bytes", count * width * dtype.itemsize, place.what)
        if "bufferView" in place:
            offset = place.integer("byteOffset", 0)
            values = self._elements(place, "bufferView", offset, dtype, width, count)
        else:
            values = np.zeros((count, width), dtype)
        return self._with_sparse(place, values) if "sparse" in place else values

    def floats(self, index: int) -> np.ndarray:
        """Read an accessor as floating-point numbers.

        Args:
            index: Number of the accessor.

        Returns:
            [count, width] float32, normalized integers scaled to [0, 1] or [-1, 1].
        """
        return as_floats(self.read(index), self._place(index).flag("normalized"))

    def layout(self, place: Place) -> tuple[np.dtype, int, int]:
        """Read the declared layout of an accessor.

        Args:
            place: Accessor object.

        Returns:
            Component type, components per element, number of elements.
        """
        code, kind = place.integer("componentType"), place.text("type")
        if code not in COMPONENT_TYPES:
            place.fail(f"has componentType {code}, expected one of {', '.join(map(str, COMPONENT_TYPES))}")
        if kind not in WIDTHS:
            place.fail(f"has type '{kind[:20]}', expected one of {', '.join(WIDTHS)}")
        return np.dtype(COMPONENT_TYPES[code]), WIDTHS[kind], place.integer("count", low=1)

    def _place(self, index: int) -> Place:
        place = self._document.item("accessors", index)
        place.what = f"accessor {index}"
        return place

    def _elements(self, place: Place, key: str, offset: int, dtype: np.dtype, width: int, count: int) -> np.ndarray:
        number = place.index(key, self._document.count("bufferViews"), "bufferView")
        if number is None:
            place.fail(f"has no {key}")
        data = self.view(number, place)
        packed = width * dtype.itemsize
        stride = self.stride(number) or packed
        if stride < packed:
            place.fail(f"has elements of {packed} bytes, but bufferView {number} a byteStride of {stride}")
        end = offset + stride * (count - 1) + packed
        if end > len(data):
            place.fail(f"reads bytes {offset}..{end} of bufferView {number}, which has {len(data)}")
        strides = (stride, dtype.itemsize)
        return np.ndarray((count, width), dtype, buffer=data, offset=offset, strides=strides).copy()

    def _with_sparse(self, place: Place, values: np.ndarray) -> np.ndarray:
        sparse = place.need("sparse")
        count = sparse.integer("count", low=1, high=len(values))
        where, what = sparse.need("indices"), sparse.need("values")
        code = where.integer("componentType")
        if code not in (5121, 5123, 5125):
            where.fail(f"has componentType {code}, expected 5121, 5123 or 5125")
        offset = where.integer("byteOffset", 0)
        rows = self._elements(where, "bufferView", offset, np.dtype(COMPONENT_TYPES[code]), 1, count)[:, 0]
        if rows.max() >= len(values):
            where.fail(f"names element {int(rows.max())}, but the accessor has {len(values)}")
        offset = what.integer("byteOffset", 0)
        values[rows] = self._elements(what, "bufferView", offset, values.dtype, values.shape[1], count)
        return values

    def _range(self, place: Place, source: Place) -> memoryview:
        """The bytes of a buffer that ``source`` names with buffer, byteOffset and byteLength."""
        number = source.index("buffer", self._document.count("buffers"), "buffer")
        if number is None:
            source.fail("has no buffer")
        data = self._document.buffer(number)
        offset, length = source.integer("byteOffset", 0), source.integer("byteLength", low=1)
        if offset + length > len(data):
            source.fail(f"reads bytes {offset}..{offset + length} of buffer {number}, which has {len(data)}")
        return memoryview(data)[offset : offset + length]

    def _meshopt(self, place: Place) -> bytes:
        data = bytes(self._range(place, place))
        count, stride = place.integer("count", low=1), place.integer("byteStride", low=1, high=256)
        mode, filter_ = place.text("mode"), place.text("filter", "NONE")
        self._document.budget.charge("decoded_bytes", count * max(stride, 4), place.what)
        if mode == "ATTRIBUTES" and stride % 4:
            place.fail(f"has byteStride {stride}, expected a multiple of 4")
        if mode != "ATTRIBUTES" and (mode not in ("TRIANGLES", "INDICES") or stride not in (2, 4)):
            place.fail(f"has mode '{mode[:20]}' and byteStride {stride}, expected a known mode and 2 or 4")
        if mode == "TRIANGLES" and count % 3:
            place.fail(f"has {count} indices, expected a multiple of 3")
        if stride not in MESHOPT_FILTERS.get(filter_, ()):
            place.fail(f"has filter '{filter_[:20]}' on elements of {stride} bytes, which do not go together")
        try:
            import meshopt
        except ImportError:
            place.fail("is compressed by meshoptimizer, whose library needs Python 3.11; use it or decompress the file")
        try:
            return meshopt.decode_gltf_buffer(data, count, stride, mode, filter_).tobytes()
        except (RuntimeError, ValueError, MemoryError) as error:
            place.fail(f"cannot be decompressed ({error})")


def as_floats(values: np.ndarray, normalized: bool) -> np.ndarray:
    """Convert integers or floats to float32.

    Args:
        values: Values of any shape.
        normalized: Scale integers to [0, 1] or [-1, 1], as glTF 2.0 defines it.

    Returns:
        float32 of the same shape.
    """
    if values.dtype.kind == "f" or not normalized:
        return values.astype(np.float32, copy=False)
    scaled = values.astype(np.float32) / np.float32(np.iinfo(values.dtype).max)
    return np.maximum(scaled, -1) if values.dtype.kind == "i" else scaled
