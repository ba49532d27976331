"""``lightwell lens check``: integrate every spreadlet of a library back and compare it with its kernel.

Each is solved alone, exactly, on a plane four times its support; with the pyramids too when one node is asked for.
Exit code 1 when a limit is broken. The file's own figures are not believed, only shown to differ.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from lightwell.lens import aperture, pyramid
from lightwell.lens.errors import LensError
from lightwell.lens.library import Library, load
from lightwell.lens.score import Score, integrate, plane_of, score
from lightwell.lens.spreadlet import CHARGE, KINDS, Spreadlet

BROKEN = 1
# Mass that a spreadlet may lose or gain, its shift in pixels, and what exact ones may be wrong by.
LIMIT_MASS, LIMIT_CENTROID, LIMIT_EXACT = 1e-3, 0.02, 1e-3
# Rows that are printed.
SHOWN = 12


@dataclass(frozen=True)
class Finding:
    """One spreadlet, measured."""

    node: int
    tier: int
    recipe: str
    radius: float
    second: float
    points: int
    score: Score
    broken: tuple[str, ...]
    """Limits that it breaks."""


def response_of(spreadlet: Spreadlet, half: tuple[int, int]) -> np.ndarray:
    """What a spreadlet alone becomes [2·hy+1, 2·hx+1]."""
    if spreadlet.kind == CHARGE:
        return integrate(spreadlet.x, spreadlet.y, spreadlet.values, half)
    image = np.zeros((2 * half[0] + 1, 2 * half[1] + 1))
    np.add.at(image, (spreadlet.y + half[0], spreadlet.x + half[1]), spreadlet.values)
    return image


def check_node(library: Library, node: int, tier: int, limit_error: float, limit_leak: float) -> Finding:
    """Measure one spreadlet against limits on relative L2, leak, mass, centroid and the sum of its charges."""
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
    """All spreadlets of a library, or those of one node; the worst first."""
    keys = [key for key in sorted(library.nodes) if node is None or key[0] == node]
    if not keys:
        baked = sorted({key[0] for key in library.nodes})
        span = f"{baked[0]} to {baked[-1]}" if baked else "none"
        raise LensError(f"lens check: the library has no node {node}; baked are {span}")
    found = [check_node(library, *key, limit_error, limit_leak) for key in keys]
    return sorted(found, key=lambda f: (not f.broken, -f.score.error))


def with_pyramids(spreadlet: Spreadlet, kernel: np.ndarray) -> dict[str, Score]:
    """The same spreadlet through both pyramids."""
    half = tuple(h + 8 for h in plane_of(kernel))
    image = np.zeros((2 * half[0] + 1, 2 * half[1] + 1))
    np.add.at(image, (spreadlet.y + half[0], spreadlet.x + half[1]), spreadlet.values)
    if spreadlet.kind != CHARGE:
        return {}
    kinds = {"5/3": pyramid.FIVE, "7/5": pyramid.SEVEN}
    return {name: score(kernel, pyramid.integrate(image, kernels)) for name, kernels in kinds.items()}


def run_check(arguments) -> int:
    """Print the findings, worst first; draw them where asked."""
    if not arguments.library:
        raise LensError("lens check: name a library, for example: lightwell lens check disc.lwsp")
    shape = None
    if arguments.aperture not in ("disc", *aperture.POLYGONS):
        shape = aperture.parse(arguments.aperture)
    library = load(arguments.library, shape)
    found = check(library, arguments.limit_error, arguments.limit_leak, arguments.node)
    broken = [f for f in found if f.broken]
    pyramids = {}
    if arguments.node is not None:
        worst = found[0]
        pyramids = with_pyramids(library.nodes[worst.node, worst.tier], library.family.kernel(worst.node))
    if arguments.plot:
        from lightwell.lens.plot import picture

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


def _print(library: Library, found: list[Finding], broken: list[Finding], pyramids: dict[str, Score]) -> None:
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


def planted(library: Library, fault: str) -> Library:
    """A copy of a library with a fault in every sparse spreadlet, for tests of this tool."""
    changed = {}
    for key, s in library.nodes.items():
        if s.kind == CHARGE:
            x, y, q = s.x.copy(), s.y.copy(), s.q.copy()
            if fault == "dropped point":
                x, y, q = x[1:], y[1:], q[1:]
            elif fault == "wrong sign":
                q = -q
            elif fault == "transposed":
                x, y = y, x
            elif fault == "shifted":
                x = x + np.int16(1)
            elif fault == "broken sum":
                q[0] += 1
            s = Spreadlet(s.kind, x, y, q, s.scale, s.recipe, s.score)
        changed[key] = s
    return Library(library.family, library.recipe, changed)
