"""Textures of a glTF file: images decoded once, WebP and KTX2 converted to PNG or JPEG, samplers, transforms."""

from __future__ import annotations

import hashlib
import io
import math
import warnings
from collections.abc import Callable

import numpy as np
from PIL import Image as PillowImage

from lightwell.basisu import codec as basisu
from lightwell.core.image_io import eight_bits
from lightwell.scenes.errors import SceneError
from lightwell.scenes.gltf_accessors import Accessors
from lightwell.scenes.gltf_container import Document
from lightwell.scenes.gltf_json import Place
from lightwell.scenes.scene import Image, Texture

WRAPS = {33071: "clamp", 33648: "mirror", 10497: "repeat"}
# The magnification filter NEAREST; all others are bilinear here.
NEAREST = 9728
# Formats that glTF files hold in practice; Pillow's other readers are not used on untrusted bytes.
FORMATS = ("PNG", "JPEG", "WEBP", "BMP", "GIF", "TGA", "TIFF")
# Quality of the JPEG that replaces a lossy WebP; high, because the image was already compressed once.
JPEG_QUALITY = 95


class Textures:
    """Reads texture references; an image that cannot be read causes a warning and counts as absent."""

    def __init__(self, document: Document, accessors: Accessors, warn: Callable[[str], None]) -> None:
        """Prepare the reading of one file.

        Args:
            document: The file.
            accessors: Its accessors.
            warn: Called with each image that cannot be read.
        """
        self._document, self._accessors, self._warn = document, accessors, warn
        self._images: dict[int, Image | None] = {}
        # By digest of the encoded bytes: files store one image under several numbers.
        self._decoded: dict[bytes, Image] = {}
        self._charged: set[bytes] = set()
        # Computed from the images of the file, by what they depend on.
        self._made: dict[tuple[object, ...], Image] = {}

    def read(self, owner: Place, key: str) -> Texture | None:
        """Read the texture that an element refers to.

        Args:
            owner: Element, such as a material.
            key: Name of the reference.

        Returns:
            The texture, or None.
        """
        reference = owner.place(key)
        if reference is None:
            return None
        number = reference.index("index", self._document.count("textures"), "texture")
        if number is None:
            reference.fail("has no index")
        place = self._document.item("textures", number)
        image = self._source(place)
        if image is None:
            return None
        transform, uv_set = _transform(reference)
        if uv_set > 1:
            self._warn(f"{reference.what}: uses TEXCOORD_{uv_set}; only 0 and 1 are loaded, 0 is used")
            uv_set = 0
        return Texture(image, *self._sampler(place), uv_set=uv_set, transform=transform)

    def made(self, key: tuple[object, ...], name: str, texels: Callable[[], np.ndarray]) -> Image:
        """Make an image from those of the file, once.

        Args:
            key: What it depends on.
            name: Name of the image.
            texels: Computes [H, W, 3 or 4] uint8.

        Returns:
            The image.
        """
        if key not in self._made:
            values = texels()
            self._document.budget.check_picture(values.shape[1], values.shape[0], f"image '{name}'")
            self._made[key] = png_image(name, values)
        return self._made[key]

    def _sampler(self, place: Place) -> tuple[tuple[str, str], bool]:
        number = place.index("sampler", self._document.count("samplers"), "sampler")
        if number is None:
            return ("repeat", "repeat"), False
        sampler = self._document.item("samplers", number)
        wrap = tuple(WRAPS.get(sampler.integer(key, 10497)) for key in ("wrapS", "wrapT"))
        u, v = wrap
        if u is None or v is None:
            sampler.fail("has an unknown wrap mode, expected 33071, 33648 or 10497")
        return (u, v), sampler.integer("magFilter", 9729) == NEAREST

    def _source(self, place: Place) -> Image | None:
        number = self._image_number(place)
        if number is None:
            formats = "PNG, JPEG, WebP, KTX2"
            self._warn(f"{place.what}: has no picture that lightwell reads ({formats}); the factor alone is used")
            return None
        if number not in self._images:
            self._images[number] = self._image(number)
        return self._images[number]

    def _image_number(self, texture: Place) -> int | None:
        # A PNG or JPEG is preferred to blocks, which are the same picture with more error.
        order = [texture.extension("EXT_texture_webp"), texture, texture.extension("KHR_texture_basisu")]
        holder = next((place for place in order if place is not None and "source" in place), texture)
        return holder.index("source", self._document.count("images"), "image")

    def _image(self, number: int) -> Image | None:
        place = self._document.item("images", number)
        name = place.text("name", "") or f"image {number}"
        self._document.budget.check_time(place.what)
        data = self._bytes(place)
        key = hashlib.sha256(data).digest()
        if key in self._decoded:
            return self._decoded[key]
        if basisu.is_ktx2(data) and (missing := basisu.missing()):
            self._warn(f"{place.what} ('{name}'): is not read ({missing}); the factor alone is used")
            return None
        try:
            image = _of_blocks(name, data) if basisu.is_ktx2(data) else encoded_image(name, data)
            image.pixels  # noqa: B018  decode now, so that damage is found here
        except Exception as error:  # Pillow's readers raise many types for a damaged image
            self._warn(f"{place.what} ('{name}'): cannot be decoded ({_line(error)}); the factor alone is used")
            return None
        self._decoded[key] = image
        return image

    def _found(self, place: Place) -> bytes | None:
        """Read the bytes of an image; None, with a warning, when its file is missing."""
        try:
            return self._bytes(place)
        except SceneError as error:
            if "uri" not in place or "which is missing" not in str(error):
                raise
            self._warn(f"{place.what}: its file '{place.text('uri')[:60]}' is missing; the factor alone is used")
            return None

    def charge(self) -> None:
        """Charge the size of every image that a texture refers to, from its header, before any image is decoded."""
        count = self._document.count("textures")
        textures = (self._document.item("textures", i) for i in range(count))
        numbers = [self._image_number(texture) for texture in textures]
        for number in dict.fromkeys(n for n in numbers if n is not None):
            place = self._document.item("images", number)
            data = self._found(place)
            if data is None:
                self._images[number] = None
                continue
            key = hashlib.sha256(data).digest()
            if key not in self._charged:
                self._charged.add(key)
                self._charge(place, data)

    def _charge(self, place: Place, data: bytes) -> None:
        if basisu.is_ktx2(data):
            # A file that is cut short is reported where it is decoded.
            width, height = basisu.size(data) if len(data) >= basisu.HEADER_BYTES else (0, 0)
            self._document.budget.check_picture(width, height, place.what)
            return
        try:
            with warnings.catch_warnings():
                # The budget limits sizes, not Pillow's own bound.
                warnings.simplefilter("ignore", PillowImage.DecompressionBombWarning)
                with PillowImage.open(io.BytesIO(data), formats=FORMATS) as picture:
                    width, height = picture.size
        except PillowImage.DecompressionBombError:
            place.fail(f"is a picture of more than {2 * (PillowImage.MAX_IMAGE_PIXELS or 0)} texels", "make it smaller")
        except Exception:  # reported where it is decoded
            return
        self._document.budget.check_picture(width, height, place.what)

    def _bytes(self, place: Place) -> bytes:
        view = place.index("bufferView", self._document.count("bufferViews"), "bufferView")
        if view is not None:
            return bytes(self._accessors.view(view, place))
        return self._document.resource(place, place.text("uri"))


def encoded_image(name: str, data: bytes) -> Image:
    """Make an ``Image`` of encoded bytes: PNG and JPEG are kept, other formats are converted.

    Args:
        name: Name of the image.
        data: Encoded bytes.

    Returns:
        The image.
    """
    with PillowImage.open(io.BytesIO(data), formats=FORMATS) as picture:
        if picture.format in ("PNG", "JPEG"):
            return Image(name, data, "image/png" if picture.format == "PNG" else "image/jpeg")
        lossy = picture.format == "WEBP" and data[12:16] != b"VP8L" and not picture.has_transparency_data
        out = io.BytesIO()
        if lossy:
            picture.convert("RGB").save(out, "JPEG", quality=JPEG_QUALITY, subsampling=0)
        else:
            eight_bits(picture).convert("RGBA" if picture.has_transparency_data else "RGB").save(out, "PNG")
    return Image(name, out.getvalue(), "image/jpeg" if lossy else "image/png")


def png_image(name: str, texels: np.ndarray) -> Image:
    """Make an ``Image`` of texels.

    Args:
        name: Name of the image.
        texels: [H, W, 3 or 4] uint8.

    Returns:
        The image, a PNG; alpha of 255 everywhere is left out.
    """
    opaque = texels.shape[2] == 4 and bool((texels[..., 3] == 255).all())
    out = io.BytesIO()
    PillowImage.fromarray(np.ascontiguousarray(texels[..., :3] if opaque else texels)).save(out, "PNG")
    return Image(name, out.getvalue(), "image/png")


def _of_blocks(name: str, data: bytes) -> Image:
    """The largest level of a KTX2 picture."""
    return png_image(name, basisu.decode_with_alpha(data))


def _line(error: BaseException) -> str:
    return " ".join(str(error).split())[:100] or type(error).__name__


def _transform(reference: Place) -> tuple[tuple[tuple[float, ...], ...] | None, int]:
    """Read the 3x3 matrix of KHR_texture_transform (None for none) and the coordinate set."""
    uv_set = reference.integer("texCoord", 0)
    extension = reference.extension("KHR_texture_transform")
    if extension is None:
        return None, uv_set
    (x, y), (su, sv) = extension.numbers("offset", 2, (0.0, 0.0)), extension.numbers("scale", 2, (1.0, 1.0))
    angle = extension.number("rotation", 0.0)
    c, s = math.cos(angle), math.sin(angle)
    matrix = np.array([[c * su, s * sv, x], [-s * su, c * sv, y], [0, 0, 1]])
    rows = tuple(tuple(float(v) for v in row) for row in matrix)
    return (None if np.array_equal(matrix, np.eye(3)) else rows), extension.integer("texCoord", uv_set)
