"""Libraries of spreadlets as files: a JSON header and a little-endian body (format/LENS.md).

    bytes 0-3   "LWSP"
    bytes 4-7   version, uint32
    bytes 8-11  length of the header, uint32, a multiple of 4
    header      JSON, UTF-8, padded with spaces
    body        points, 4 bytes each (int8 dx, int8 dy, int16 q) or 8 (int16 dx, dy, q, 0)

A file holds the nodes that were baked; the other nodes of its grid are baked when a frame needs them.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.files import make_folder, write_atomically
from lightwell.lens.aperture import Aperture
from lightwell.lens.errors import LensError
from lightwell.lens.families import STORED, Family
from lightwell.lens.grid import Axis
from lightwell.lens.recipes import Recipe
from lightwell.lens.score import LibraryScore
from lightwell.lens.spreadlet import CHARGE, KINDS, Spreadlet
from lightwell.limits import Limits

MAGIC, VERSION = b"LWSP", 1
RECIPE_NAMES, ANNEALS = ("default", "best", "paper"), ("none", "published", "working")
# Members of recipes are below this; seeds may be large.
MOST_RECIPE = 2**63
SCORES = ("error", "leak", "mass", "centroid", "undershoot", "peak")
FACTS = ("node", "tier", "kind", "recipe", "first", "count", "scale", *SCORES)


@dataclass
class Library:
    """Baked nodes of one family."""

    family: Family
    recipe: Recipe
    nodes: dict[tuple[int, int], Spreadlet] = field(default_factory=dict)
    """{(node, tier): spreadlet}; every baked node has tier 0."""

    def missing(self, nodes: np.ndarray) -> list[int]:
        """Find nodes that are not baked yet.

        Args:
            nodes: Indices of nodes [n].

        Returns:
            Those without a spreadlet, ascending, without duplicates.
        """
        return [int(n) for n in np.unique(nodes) if (int(n), 0) not in self.nodes]

    def key(self) -> str:
        """Compute the key of the configuration.

        Returns:
            16 hexadecimal digits; the same for the same family, recipe and format version.
        """
        facts = self.family.describe() | {"recipe": asdict(self.recipe), "version": VERSION}
        return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:16]

    def tobytes(self) -> bytes:
        """Encode the library as a file; the bytes depend only on the configuration and the set of baked nodes.

        Returns:
            Contents of the file.
        """
        keys = sorted(self.nodes)
        spreadlets = [self.nodes[key] for key in keys]
        x, y, q = (np.concatenate([getattr(s, n) for s in spreadlets]) for n in "xyq") if keys else (np.zeros(0),) * 3
        small = not len(x) or max(np.abs(x).max(), np.abs(y).max()) <= 127
        body = _pack(x, y, q, small)
        counts = np.array([len(s) for s in spreadlets], np.int64)
        records = {
            "node": [k[0] for k in keys],
            "tier": [k[1] for k in keys],
            "kind": [KINDS[s.kind] for s in spreadlets],
            "recipe": [s.recipe for s in spreadlets],
            "first": (np.cumsum(counts) - counts).tolist(),
            "count": counts.tolist(),
            "scale": [s.scale for s in spreadlets],
        }
        for name in SCORES:
            records[name] = [float(f"{getattr(s.score, name):.4g}") for s in spreadlets]
        header = self.family.describe() | {
            "format": "lightwell-spreadlets",
            "recipe": asdict(self.recipe),
            "offset_bits": 8 if small else 16,
            "points": int(counts.sum()),
            "sha256": hashlib.sha256(body).hexdigest(),
            "records": records,
        }
        text = json.dumps(header, separators=(",", ":"), sort_keys=True).encode()
        text += b" " * (-len(text) % 4)
        return MAGIC + np.array([VERSION, len(text)], "<u4").tobytes() + text + body

    def save(self, path: Path) -> None:
        """Write the file, so that it is either complete or absent; missing folders are created.

        Args:
            path: File to write.
        """
        make_folder(Path(path).parent)
        write_atomically(path, self.tobytes())


def _pack(x: np.ndarray, y: np.ndarray, q: np.ndarray, small: bool) -> bytes:
    kind = (
        [("x", "i1"), ("y", "i1"), ("q", "<i2")] if small else [("x", "<i2"), ("y", "<i2"), ("q", "<i2"), ("_", "<i2")]
    )
    points = np.zeros(len(q), kind)
    points["x"], points["y"], points["q"] = x, y, q
    return points.tobytes()


def load(path: str | Path, aperture: Aperture | None = None, limits: Limits | None = None) -> Library:
    """Read and check a library.

    Args:
        path: The file.
        aperture: Aperture of the family; needed to bake further nodes of a drawn mask.
        limits: Largest file (``decoded_bytes``) and most records (``nodes``); None for ``Limits()``.

    Returns:
        The library.

    Raises:
        LensError: The file is missing, exceeds a limit or is damaged.
    """
    path = Path(path)
    try:
        size = path.stat().st_size
        (limits or Limits()).budget(f"lens: library {path}", LensError).check("decoded_bytes", size)
        data = path.read_bytes()
    except FileNotFoundError:
        raise LensError(f"lens: no library {path}; write one with: lightwell lens bake {path}") from None
    except IsADirectoryError:
        raise LensError(f"lens: {path} is a folder; name a library file") from None
    return loads(data, str(path), aperture, limits)


def loads(
    data: bytes, where: str = "library", aperture: Aperture | None = None, limits: Limits | None = None
) -> Library:
    """Decode a library; everything that later code relies on is checked.

    Args:
        data: Contents of a file.
        where: Name of the file, for messages.
        aperture: Aperture of the family; needed to bake further nodes of a drawn mask.
        limits: Most records (``nodes``); None for ``Limits()``.

    Returns:
        The library.

    Raises:
        LensError: The data are damaged or exceed a limit.
    """
    try:
        return _loads(data, aperture, limits or Limits())
    except LensError as error:
        raise LensError(f"lens: {where}: {error}; bake the library again") from None
    except ValueError:
        raise LensError(
            f"lens: {where} is not a library of spreadlets (its header is not JSON); bake it again"
        ) from None
    except (KeyError, TypeError, OverflowError, AttributeError, RecursionError) as error:
        raise LensError(f"lens: {where} is not a library of spreadlets ({error!r:.200}); bake it again") from None


def _loads(data: bytes, aperture: Aperture | None, limits: Limits) -> Library:
    if len(data) < 12 or data[:4] != MAGIC:
        raise LensError("does not begin with LWSP")
    version, length = (int(v) for v in np.frombuffer(data, "<u4", 2, 4))
    if version != VERSION:
        raise LensError(f"has version {version}, this program reads {VERSION}")
    if 12 + length > len(data):
        raise LensError("ends within its header")
    header = json.loads(data[12 : 12 + length].decode("utf-8"))
    body = data[12 + length :]
    count, bits = header["points"], header["offset_bits"]
    if header["format"] != "lightwell-spreadlets" or bits not in (8, 16):
        raise LensError("has an unknown layout")
    if type(count) is not int or count < 0 or len(body) != count * bits // 2:
        raise LensError(f"has {len(body)} bytes of points where its header says {count}")
    if hashlib.sha256(body).hexdigest() != header["sha256"]:
        raise LensError("has points that do not match their check sum")
    family = _family(header, aperture)
    recipe = _recipe(header["recipe"])
    kind = (
        [("x", "i1"), ("y", "i1"), ("q", "<i2")]
        if bits == 8
        else [("x", "<i2"), ("y", "<i2"), ("q", "<i2"), ("_", "<i2")]
    )
    records = header["records"]
    if len(records["node"]) > limits.nodes:
        raise LensError(f"has {len(records['node'])} records, more than the limit of {limits.nodes} (--limit nodes=N)")
    return Library(family, recipe, _spreadlets(records, np.frombuffer(body, kind), family))


def _family(header: dict[str, Any], aperture: Aperture | None) -> Family:
    if header["family"] not in STORED:
        raise LensError(f"holds a family {header['family']!r:.40}, known are {', '.join(STORED)}")
    axes: list[Any] = []
    for axis in header["axes"]:
        values = np.asarray(axis["values"], np.float64)
        if (
            values.ndim != 1
            or not 1 <= len(values) <= 65536
            or not np.isfinite(values).all()
            or (np.diff(values) <= 0).any()
        ):
            raise LensError(f"has an axis {axis['name']!r:.40} that does not ascend")
        axes.append(Axis(str(axis["name"]), tuple(values.tolist())))
    shape = aperture or _aperture(header["aperture"])
    strength = header.get("strength", 0.0)
    if isinstance(strength, bool) or not isinstance(strength, (int, float)) or not 0 <= strength < 1.8:
        raise LensError(f"has a strength of {strength!r:.40}, expected 0 to 1.8")
    family = Family(header["family"], *axes)
    return replace(family, aperture=shape, strength=float(strength))


def _recipe(found: dict[str, Any]) -> Recipe:
    """A recipe whose members have the types and ranges of ``Recipe``."""
    default = asdict(Recipe())
    for name, value in found.items():
        kind = type(default[name])
        if isinstance(value, bool) or not isinstance(value, (int, float) if kind is float else kind):
            raise LensError(f"has a recipe whose {name} is {value!r:.40}")
        if kind is not str and not 0 <= value < MOST_RECIPE:
            raise LensError(f"has a recipe whose {name} is {value!r:.40}, expected 0 to {MOST_RECIPE:g}")
    if found.get("name", "default") not in RECIPE_NAMES or found.get("anneal", "none") not in ANNEALS:
        raise LensError(f"has a recipe {found.get('name')!r:.40} that is not known")
    return Recipe(**found)


def _aperture(key: str) -> Aperture:
    """Make the aperture of a key; the picture of a mask cannot be recovered from its hash, so it cannot be baked."""
    if key == "disc":
        return Aperture()
    kind, *rest = key.split("-", 1)
    if kind == "polygon":
        blades, angle = rest[0].split("-", 1)
        return Aperture("polygon", int(blades), float(angle))
    if kind == "mask":
        return Aperture("mask", mask=(b"", 0), label=key)
    raise LensError(f"has an unknown aperture {key!r:.40}")


def _spreadlets(records: dict[str, Any], points: np.ndarray, family: Family) -> dict[tuple[int, int], Spreadlet]:
    """Decode the records, each checked against the points and the grid."""
    total = len(records["node"])
    if any(len(records[name]) != total for name in FACTS):
        raise LensError("has records of different lengths")
    made = {}
    for node, tier, kind, recipe, first, count, scale, *scores in zip(*(records[name] for name in FACTS)):
        whole = all(type(v) is int for v in (node, tier, first, count))
        if not whole or not 0 <= node < family.size or tier not in (0, 1) or kind not in KINDS:
            raise LensError(f"has a record for node {node!r:.40}, tier {tier!r:.40}, kind {kind!r:.40}")
        if not (0 <= first and 0 < count and first + count <= len(points)):
            raise LensError(f"has a node {node} whose points lie outside the file")
        if not (np.isfinite(scale) and 0 < scale < 1e6 and np.isfinite(scores).all()):
            raise LensError(f"has a node {node} with a scale of {scale!r:.40}")
        mine = points[first : first + count]
        total_q = int(mine["q"].astype(np.int64).sum())
        if KINDS.index(kind) == CHARGE and total_q != 0:
            raise LensError(f"has a node {node} whose charges sum to {total_q}, not 0")
        x, y = mine["x"].astype(np.int16), mine["y"].astype(np.int16)
        q = mine["q"].astype(np.int16)
        made[node, tier] = Spreadlet(
            KINDS.index(kind), x, y, q, float(scale), str(recipe), LibraryScore(*map(float, scores))
        )
    return made


def two_arrays(library: Library) -> tuple[np.ndarray, np.ndarray]:
    """Convert a library to the published layout of two arrays.

    Primal nodes are written as the charges of their kernel, so that every value belongs to the Laplacian.

    Args:
        library: The library.

    Returns:
        Points (x, y, value) [n, 3] float32 in grid order, and cumulative counts [size + 1] int64.
    """
    from lightwell.lens.recipes import lossless

    rows, ends = [], [0]
    for index in range(library.family.size):
        s = library.nodes.get((index, 0))
        if s is not None and s.kind != CHARGE:
            s = lossless(library.family.kernel(index))
        if s is not None:
            rows.append(np.stack([s.x, s.y, s.values], 1).astype(np.float32))
        ends.append(ends[-1] + (len(s) if s is not None else 0))
    return np.concatenate(rows) if rows else np.zeros((0, 3), np.float32), np.array(ends, np.int64)
