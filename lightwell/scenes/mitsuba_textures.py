"""Textures of a Mitsuba scene as records: a bitmap's file, a checkerboard as a small image, else the mean colour."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image as PillowImage

from lightwell.backend import mi
from lightwell.core.color import srgb_bytes
from lightwell.scenes.gltf_images import encoded_image
from lightwell.scenes.mitsuba_graph import MitsubaDocument, MitsubaElement
from lightwell.scenes.scene import Image, Texture


def png(name: str, pixels: np.ndarray) -> Image:
    """Encode an image as PNG.

    Args:
        name: Name of the image.
        pixels: [height, width, 3 or 4] uint8.

    Returns:
        The encoded image.
    """
    out = io.BytesIO()
    PillowImage.fromarray(pixels).save(out, "PNG")
    return Image(name, out.getvalue(), "image/png")


class BitmapTextures:
    """Reads texture nodes, each image once."""

    def __init__(self, graph: MitsubaDocument, warn: Callable[[str], None]) -> None:
        """Prepare the reading of one file.

        Args:
            graph: Nodes of the file.
            warn: Called for each image that cannot be read.
        """
        self._graph, self._warn = graph, warn
        self._images: dict[tuple[Any, ...], Image] = {}

    def read(self, node: MitsubaElement, *, raw: bool = False) -> Texture | None:
        """Convert a texture node.

        Args:
            node: Texture node.
            raw: The values are no colours.

        Returns:
            The texture, or None when no image can represent it.
        """
        if node.plugin == "bitmap":
            image = self._bitmap(node, raw)
            wrap = node.get("wrap_mode", "repeat")
            nearest = node.get("filter_type", "bilinear") == "nearest"
            if image is None:
                return None
            return Texture(image, (wrap, wrap), nearest, transform=self._transform(node))
        if node.plugin == "checkerboard":
            first, second = self.mean(node, "color0"), self.mean(node, "color1")
            pixels = srgb_bytes(np.array([[first, second], [second, first]]))
            return Texture(png(node.name, pixels), nearest=True, transform=self._transform(node))
        return None

    def mean(self, node: MitsubaElement, key: str | None = None) -> np.ndarray:
        """Compute the mean colour of a texture.

        Args:
            node: Texture node, or the parent of one.
            key: Name of the parent's parameter; None: ``node`` is the texture.

        Returns:
            [3] linear RGB.
        """
        if key is not None:
            child = self._graph.child(node, key)
            if child is not None:
                return self.mean(child)
            params = mi.traverse(self._graph.make(node))
            return _three(params[f"{key}.value"]) if f"{key}.value" in params else np.full(3, 0.5)
        made = self._graph.make(node)
        params = mi.traverse(made)
        for name in ("value", "data"):
            if name in params:
                values = np.array(params[name], np.float64)
                return _three(values.reshape(-1, values.shape[-1]).mean(axis=0) if name == "data" else values)
        return _three(np.array(made.mean()))

    def _transform(self, node: MitsubaElement) -> tuple[tuple[float, ...], ...] | None:
        params = mi.traverse(self._graph.make(node))
        matrix = np.array(params["to_uv"].matrix, np.float64).reshape(3, 3)
        return None if np.array_equal(matrix, np.eye(3)) else tuple(tuple(map(float, row)) for row in matrix)

    def _bitmap(self, node: MitsubaElement, raw: bool) -> Image | None:
        name, linear = node.get("filename"), bool(node.get("raw", False))
        key = (name or node.index, linear and not raw)
        if key not in self._images:
            self._images[key] = self._encoded(node, name, linear, raw)
        return self._images[key]

    def _encoded(self, node: MitsubaElement, name: str | None, linear: bool, raw: bool) -> Image:
        """Return the file itself if its colours are sRGB-encoded (or raw values are requested), else an 8-bit copy."""
        if name is not None and linear == raw:
            try:
                image = encoded_image(Path(name).name, Path(name).read_bytes())
                # Decoded now, and not kept, so that damage that only Pillow reports is found here.
                PillowImage.open(io.BytesIO(image.data)).load()
                return image
            except Exception:  # not an image format of Pillow (EXR, HDR); Mitsuba reads it
                pass
        pixels = np.array(mi.traverse(self._graph.make(node))["data"], np.float64)
        pixels = np.repeat(pixels, 3, axis=2) if pixels.shape[2] == 1 else pixels
        if raw:
            codes = (np.clip(pixels, 0, 1) * 255 + 0.5).astype(np.uint8)
        else:
            codes = srgb_bytes(pixels)
        return png(Path(name).stem if name else node.name, codes)


def _three(values: Any) -> np.ndarray:
    values = np.array(values, np.float64).ravel()
    return np.repeat(values, 3) if values.size == 1 else values[:3]
