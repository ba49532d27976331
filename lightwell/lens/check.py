"""``lightwell lens check``: solve every spreadlet of a library and compare the result with its kernel.

Each spreadlet is solved alone and exactly, on a plane four times its support; with the convolution pyramids too when
one node is named. Exit code 1 when a limit is exceeded. Errors are computed anew; those stored in the file are not
used.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from lightwell.files import check_writable
from lightwell.lens import aperture, pyramid
from lightwell.lens.errors import LensError
from lightwell.lens.kept import check_inputs_are_kept
from lightwell.lens.library import Library, load
from lightwell.lens.plot import picture
from lightwell.lens.score import LibraryScore, plane_of, score
from lightwell.lens.spreadlet import CHARGE, KINDS, Spreadlet, response_of
from lightwell.limits import Limits

BROKEN = 1
# Limits: relative change of mass, shift of the centroid in pixels, relative error of exact spreadlets.
LIMIT_MASS, LIMIT_CENTROID, LIMIT_EXACT = 1e-3, 0.02, 1e-3
# Number of spreadlets that are printed.
SHOWN = 12


@dataclass(frozen=True)
class Finding:
    """Measured errors of one spreadlet."""

    node: int
    tier: int
    recipe: str
    radius: float
    second: float
    points: int
    score: LibraryScore
    broken: tuple[str, ...]
    """Names of the limits that are exceeded."""


def check_node(library: Library, node: int, tier: int, limit_error: float, limit_leak: float) -> Finding:
    """Measure one spreadlet against limits on relative L2 error, leak, mass, centroid and the sum of its charges.

    Args:
        library: The library.
        node: Index of a baked node.
        tier: ``MAIN`` or ``FINE``.
        limit_error: Largest relative L2 error of a sparse spreadlet.
        limit_leak: Largest share of light outside the support of a sparse spreadlet.

    Returns:
        Errors, and the names of the limits that are exceeded.
    """
    spreadlet = library.nodes[node, tier]
    kernel = library.family.kernel(node)
    found = score(kernel, response_of(spreadlet, plane_of(kernel)))
    exact = spreadlet.recipe in ("primal", "lossless")
    published = spreadlet.recipe == "voronoi"
    broken = []
    if found.error > (LIMIT_EXACT if exact else limit_error):
        broken.append("error")
    if found.leak > (LIMIT_EXACT if exact else limit_leak):
        broken.append("leak")
    if abs(found.mass) > LIMIT_MASS and not published:
        broken.append("mass")
    if found.centroid > LIMIT_CENTROID and not published:
        broken.append("centroid")
    if spreadlet.kind == CHARGE and int(spreadlet.q.astype(np.int64).sum()) != 0:
        broken.append("sum")
    radius, second, _ = library.family.node(node)
    return Finding(node, tier, spreadlet.recipe, radius, second, len(spreadlet), found, tuple(broken))


def check(
    library: Library, limit_error: float = 0.2, limit_leak: float = 0.05, node: int | None = None
) -> list[Finding]:
    """Measure all spreadlets of a library, or those of one node.

    Args:
        library: The library.
        limit_error: Largest relative L2 error of a sparse spreadlet.
        limit_leak: Largest share of light outside the support of a sparse spreadlet.
        node: Index of a node; None for all.

    Returns:
        One result per spreadlet, the worst first.

    Raises:
        LensError: The library has no such node.
    """
    keys = [key for key in sorted(library.nodes) if node is None or key[0] == node]
    if not keys:
        baked = sorted({key[0] for key in library.nodes})
        span = f"{baked[0]} to {baked[-1]}" if baked else "none"
        raise LensError(f"lens check: the library has no node {node}; baked are {span}")
    found = [check_node(library, *key, limit_error, limit_leak) for key in keys]
    return sorted(found, key=lambda f: (not f.broken, -f.score.error))


def with_pyramids(spreadlet: Spreadlet, kernel: np.ndarray) -> dict[str, LibraryScore]:
    """Measure a spreadlet that is solved by each of the convolution pyramids.

    Args:
        spreadlet: The spreadlet.
        kernel: Its point spread function [2·hy+1, 2·hx+1].

    Returns:
        Pyramid name → errors; empty for primal spreadlets, which need no solve.
    """
    half = tuple(h + 8 for h in plane_of(kernel))
    image = np.zeros((2 * half[0] + 1, 2 * half[1] + 1))
    np.add.at(image, (spreadlet.y + half[0], spreadlet.x + half[1]), spreadlet.values)
    if spreadlet.kind != CHARGE:
        return {}
    kinds = {"5/3": pyramid.FIVE, "7/5": pyramid.SEVEN}
    return {name: score(kernel, pyramid.integrate(image, kernels)) for name, kernels in kinds.items()}


def run_check(arguments: argparse.Namespace) -> int:
    """Check a library, print the worst spreadlets and write a picture of one where ``--plot`` is given.

    Args:
        arguments: Parsed options of the verb ``lens``.

    Returns:
        Exit code: 0, or 1 when a limit is exceeded.
    """
    if arguments.aperture in aperture.POLYGONS:
        raise LensError(
            f"lens check: a library knows its polygon; leave out --aperture {arguments.aperture}, which is for the "
            "picture of a drawn shape"
        )
    pictures = aperture.picture_of(arguments.aperture)
    shape = aperture.parse(arguments.aperture) if pictures else None
    if arguments.plot:
        check_inputs_are_kept("lens check", [("--plot", arguments.plot)], [("LIBRARY", arguments.library), *pictures])
    library = _of_shape(load(arguments.library, None, Limits.parse(getattr(arguments, "limits", ()))), shape)
    if arguments.plot:
        check_writable(arguments.plot)
    found = check(library, arguments.limit_error, arguments.limit_leak, arguments.node)
    broken = [f for f in found if f.broken]
    pyramids = {}
    if arguments.node is not None:
        worst = found[0]
        pyramids = with_pyramids(library.nodes[worst.node, worst.tier], library.family.kernel(worst.node))
    if arguments.plot:
        picture(library, found[0].node, found[0].tier, Path(arguments.plot))
    if arguments.json:
        facts = [asdict(f) for f in found]
        print(
            json.dumps(
                {"broken": len(broken), "spreadlets": facts, "pyramids": {k: asdict(v) for k, v in pyramids.items()}}
            )
        )
    else:
        _print(library, found, broken, pyramids)
    return BROKEN if broken else 0


def _of_shape(library: Library, shape: aperture.Aperture | None) -> Library:
    """Give a library the picture of its shape; refuse that of another one, by which every node would look broken."""
    if shape is None:
        return library
    if (stored := library.family.aperture.key()) != shape.key():
        raise LensError(f"lens check: the library was baked for the aperture {stored}, not this picture; give its own")
    return replace(library, family=replace(library.family, aperture=shape))


def _print(library: Library, found: list[Finding], broken: list[Finding], pyramids: dict[str, LibraryScore]) -> None:
    print("  node tier  radius     2nd recipe    points    error     leak      mass")
    for f in found[:SHOWN]:
        s = f.score
        note = f"  breaks {', '.join(f.broken)}" if f.broken else ""
        print(
            f"{f.node:>6} {f.tier:>4} {f.radius:>7.2f} {f.second:>7.2f} {f.recipe:<9}{f.points:>7} {s.error:>8.4f} "
            f"{s.leak:>8.4f} {s.mass:>9.1e}{note}"
        )
    for name, s in pyramids.items():
        print(f"through the pyramid {name}: error {s.error:.4f}, leak {s.leak:.4f}, mass {s.mass:+.3f}")
    size = sum(len(s) for s in library.nodes.values())
    kinds = ", ".join(f"{sum(1 for s in library.nodes.values() if s.kind == k)} {name}" for k, name in enumerate(KINDS))
    verdict = f"{len(broken)} break a limit" if broken else "all within limits"
    print(f"{len(found)} of {len(library.nodes)} spreadlets ({kinds}; {size} points) checked: {verdict}")
