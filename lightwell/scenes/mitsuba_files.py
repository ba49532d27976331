"""Files that a Mitsuba scene names: finding them, and checking that each is of the kind that its element expects."""

from __future__ import annotations

import math
import re
import struct
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image as PillowImage

from lightwell.core.isolated import Arrays, Worker, WorkerDied, WorkerError
from lightwell.exr import ExrError, read_header
from lightwell.limits import LoadBudget
from lightwell.scenes.errors import SceneError
from lightwell.scenes.mesh_files import check_obj, check_ply
from lightwell.scenes.mitsuba_document import Element
from lightwell.scenes.mitsuba_paths import Folders

# First bytes of an image that identify its format, and memory of a worker: at least, and per byte of the file.
HEAD, LEAST_MEMORY, MEMORY_PER_BYTE = 16, 1 << 30, 64
# First bytes of PNG and JPEG: Mitsuba may open these, because its libraries for them are robust.
BY_MITSUBA = (b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff")
# First bytes of BMP and PPM, which Pillow decodes, and of the formats that Mitsuba decodes in a worker: EXR, HDR, PFM.
BY_PILLOW = (b"BM", b"P5", b"P6")
EXR = b"\x76\x2f\x31\x01"
BY_WORKER = (EXR, b"#?", b"PF", b"Pf")
# Pillow's modes of 8 bits a channel, and the one to convert to.
MODES = {"1": "L", "L": "L", "P": "RGB", "RGB": "RGB", "RGBA": "RGBA", "LA": "LA"}
# A TGA file has no magic bytes.
TGA = ".tga"
# Pillow's readers of each; its others, of which one runs PostScript, must not see a stranger's bytes.
MITSUBA_FORMATS, PILLOW_FORMATS = ("PNG", "JPEG"), ("BMP", "PPM", "TGA")
# Number of a shape in a .serialized file.
SHAPE_INDEX = re.compile(r"[0-9]{1,9}")
# Header of a volume grid: magic, version, type (1: float32), size, channels.
VOLUME = struct.Struct("<3sBiiiii")
VOLUME_BYTES = 48
# Lines of a spectrum file.
MOST_SPECTRUM_BYTES = 1 << 20


class Files:
    """Finds and checks files; each file is checked once for each kind."""

    def __init__(self, folders: Folders, budget: LoadBudget, warn: Callable[[str], None]) -> None:
        """Prepare the checks of one scene.

        Args:
            folders: Folders of the files.
            budget: Counts bytes and texels.
            warn: Called for each missing file.
        """
        self._folders, self._budget, self._warn = folders, budget, warn
        self._checked: dict[tuple[str, Path, str], str] = {}
        self._sized: set[Path] = set()
        self._worker: Worker | None = None
        self._memory = 0
        self._temporary: tempfile.TemporaryDirectory[str] | None = None
        self.missing: set[str] = set()
        """Names, as passed to Mitsuba, of files that do not exist."""
        self.pictures: dict[str, tuple[np.ndarray, bool]] = {}
        """Decoded pixels [height, width, channels] of the file names that Mitsuba must not open, and whether they are
        sRGB-encoded."""

    def close(self) -> None:
        """Stop the worker process."""
        if self._worker is not None:
            self._worker.stop()
            self._worker = None

    def find(self, name: str, element: Element) -> Path | None:
        """Find a file; one that must not be read raises ``SceneError``.

        Args:
            name: Name of the file in the scene.
            element: Element that names it.

        Returns:
            Its path, or None.
        """
        found = self._folders.find(name, element.place)
        if found is not None and found not in self._sized:
            self._sized.add(found)
            self._budget.charge("file_bytes", found.stat().st_size, f"file '{found.name}'")
        return found

    def checked(self, kind: str, name: str, element: Element) -> str:
        """Check that a file is of a kind; one that is not, or that exceeds the limits, raises ``SceneError``.

        Args:
            kind: Expected kind, such as 'ply' or 'picture'.
            name: Name of the file in the scene.
            element: Element that names it.

        Returns:
            The name of the file for Mitsuba.
        """
        found = self.find(name, element)
        if found is None:
            return self._gone(kind, name, element)
        part = element.value("shape_index") or "0" if kind == "serialized" else element.type
        key = (kind, found, part)
        if key not in self._checked:
            self._checked[key] = self._check(kind, found, part, element)
        if kind == "serialized":
            element.attributes["type"] = "ply"
        return self._checked[key]

    def spectrum(self, name: str, element: Element) -> str:
        """Read a spectrum file; one that is missing or damaged raises ``SceneError``.

        Args:
            name: Name of the file in the scene.
            element: Element that names it.

        Returns:
            The text 'wavelength:value, …'.
        """
        return _spectrum(self.find(name, element), name, element)

    def _gone(self, kind: str, name: str, element: Element) -> str:
        if kind == "picture" and element.tag != "emitter":
            self._warn(f"texture '{name}' is missing; a grey one takes its place")
        elif kind in ("ply", "obj", "serialized"):
            self._warn(f"mesh file '{name}' is missing; the shape is left out")
        elif kind == "volume":
            self._warn(f"volume file '{name}' is missing; its medium cannot be traced")
        else:
            raise element.fail(f"the file '{name[:120]}' of {element.type} does not exist; correct the name")
        self.missing.add(name)
        return name

    def _check(self, kind: str, path: Path, part: str, element: Element) -> str:
        """Check a file; returns the name to pass on instead."""
        try:
            if kind == "ply":
                check_ply(path, element.place, self._budget)
            elif kind == "obj":
                check_obj(path, element.place, self._budget)
            elif kind == "picture":
                self._picture(path, element)
            elif kind == "serialized":
                return self._serialized(path, part, element)
            elif kind == "volume":
                self._volume(path, element)
            else:
                request = {"kind": np.array(kind), "plugin": np.array(part)}
                self._ask(path, request, 0, element)
        except OSError as error:
            raise element.fail(f"'{path.name}' cannot be read ({error.strerror or error}); check the file") from None
        return str(path)

    def _picture(self, path: Path, element: Element) -> None:
        with path.open("rb") as stream:
            head = stream.read(HEAD)
        what = f"line {element.line}: picture '{path.name}'"
        if head.startswith(BY_MITSUBA):
            self._budget.check_picture(*_size(path, MITSUBA_FORMATS, element), what)
        elif head.startswith(BY_PILLOW) or path.suffix.lower() == TGA:
            self._budget.check_picture(*_size(path, PILLOW_FORMATS, element), what)
            self.pictures[str(path)] = _decoded(path, element), True
        elif head.startswith(BY_WORKER):
            if head.startswith(EXR):
                self._check_exr(path, element)
            most = 16 * self._budget.limits.picture_texels
            found = self._ask(path, {"kind": np.array("picture")}, most, element)
            pixels = found["pixels"]
            self._budget.check_picture(pixels.shape[1], pixels.shape[0], what)
            if pixels.dtype.kind == "f" and not np.isfinite(pixels).all():
                self._warn(f"picture '{path.name}': its values that are not finite are read as 0")
                pixels = np.nan_to_num(pixels, copy=False, nan=0.0, posinf=0.0, neginf=0.0)
            self.pictures[str(path)] = pixels, bool(found["srgb"])
        else:
            raise element.fail(
                f"'{path.name}' is no picture (it begins with {head[:8]!r}); "
                "give a PNG, JPEG, EXR, HDR, PFM, BMP or TGA"
            )

    def _check_exr(self, path: Path, element: Element) -> None:
        """Compare the size in the header with the limits; the pixels are charged when they are decoded."""
        alone = self._budget.limits.budget(f"{element.place}: picture '{path.name}'", SceneError)
        try:
            read_header(path, alone)
        except ExrError as error:
            raise element.fail(f"'{path.name}' cannot be read as EXR ({error}); export it again") from None

    def _serialized(self, path: Path, part: str, element: Element) -> str:
        """Write a PLY file with the same mesh."""
        if not SHAPE_INDEX.fullmatch(part.strip()):
            raise element.fail(f"shape_index is '{part[:20]}', expected a whole number; correct it")
        if self._temporary is None:
            self._temporary = tempfile.TemporaryDirectory(prefix="lightwell-")
        out = Path(self._temporary.name) / f"{len(self._checked)}.ply"
        request = {"kind": np.array("serialized"), "index": np.array(int(part)), "out": np.array(str(out))}
        self._ask(path, request, 0, element)
        check_ply(out, f"{element.place}: '{path.name}'", self._budget)
        return str(out)

    def _volume(self, path: Path, element: Element) -> None:
        with path.open("rb") as stream:
            head = stream.read(VOLUME_BYTES)
        if len(head) < VOLUME_BYTES:
            raise element.fail(f"'{path.name}' is no volume grid; export it again")
        magic, version, kind, *size = VOLUME.unpack(head[: VOLUME.size])
        wanted = VOLUME_BYTES + 4 * math.prod(size)
        if magic != b"VOL" or version != 3 or kind != 1 or min(size) < 1 or wanted != path.stat().st_size:
            raise element.fail(
                f"'{path.name}' is no volume grid of float32, or its size is not that of its header; export it again"
            )

    def _ask(self, path: Path, request: Arrays, most_bytes: int, element: Element) -> Arrays:
        """Read the file in the worker process."""
        memory = max(LEAST_MEMORY, MEMORY_PER_BYTE * path.stat().st_size)
        if self._worker is None or memory > self._memory:
            self.close()
            seconds = self._budget.limits.seconds
            self._memory = memory
            self._worker = Worker("lightwell.core.native_files:answer", seconds=seconds, memory=memory)
        try:
            return self._worker.ask({**request, "path": np.array(str(path))}, most_bytes)
        except (WorkerDied, WorkerError) as error:
            raise element.fail(
                f"'{path.name}' cannot be read ({' '.join(str(error).split())[:200]}); export it again"
            ) from None


def _spectrum(path: Path | None, name: str, element: Element) -> str:
    """Read the pairs 'wavelength:value, …' of a spectrum file."""
    if path is None or path.stat().st_size > MOST_SPECTRUM_BYTES:
        raise element.fail(f"the spectrum file '{name[:120]}' does not exist or is too large; correct the name")
    pairs = []
    for line in path.read_text("latin-1").splitlines():
        words = line.split("#", 1)[0].split()
        if not words:
            continue
        if len(words) != 2 or not all(_finite(word) for word in words):
            raise element.fail(
                f"'{path.name}' has the line '{line[:40]}', expected a wavelength and a value; correct it"
            )
        pairs.append(":".join(words))
    if not pairs:
        raise element.fail(f"the spectrum file '{path.name}' is empty; correct it")
    return ", ".join(pairs)


def _size(path: Path, formats: tuple[str, ...], element: Element) -> tuple[int, int]:
    """Read width and height from the header of a picture of one of Pillow's formats."""
    try:
        with warnings.catch_warnings():
            # Sizes are checked against the limits instead.
            warnings.simplefilter("ignore", PillowImage.DecompressionBombWarning)
            with PillowImage.open(path, formats=formats) as picture:
                return picture.size
    except PillowImage.DecompressionBombError:
        raise element.fail(f"'{path.name}' has more pixels than any picture may have; make it smaller") from None
    except Exception as error:  # Pillow's readers raise many types for a damaged image
        raise element.fail(
            f"'{path.name}' is no picture ({' '.join(str(error).split())[:120]}); save it again"
        ) from None


def _decoded(path: Path, element: Element) -> np.ndarray:
    """Decode an image with Pillow to [height, width, channels] uint8."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PillowImage.DecompressionBombWarning)
            with PillowImage.open(path, formats=PILLOW_FORMATS) as picture:
                if picture.mode not in MODES:
                    raise ValueError(f"its mode is {picture.mode}, expected 8 bits a channel")
                pixels = np.array(picture.convert(MODES[picture.mode]))
    except Exception as error:  # as in ``_size``
        raise element.fail(
            f"'{path.name}' cannot be read ({' '.join(str(error).split())[:120]}); save it as a PNG"
        ) from None
    return pixels.reshape(*pixels.shape[:2], -1)


def _finite(word: str) -> bool:
    try:
        return math.isfinite(float(word))
    except ValueError:
        return False
