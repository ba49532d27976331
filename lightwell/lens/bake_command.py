"""``lightwell lens bake``: write a library with all its nodes."""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np

from lightwell.files import check_writable, make_folder
from lightwell.lens import aperture, families
from lightwell.lens.bake import bake_nodes
from lightwell.lens.errors import LensError
from lightwell.lens.kept import check_inputs_are_kept
from lightwell.lens.library import Library, two_arrays
from lightwell.lens.progress import bars
from lightwell.lens.settings import PRESETS, LensSettings

# Largest blur radius and longest motion that are baked by default, pixels.
LARGEST, LONGEST = 32.0, 64.0
# Strength of a cat's eye where none is given.
CATS_EYE = 1.0
# Largest number of nodes; more would bake for hours.
MOST_NODES = 20_000


def family_of(arguments: argparse.Namespace) -> families.Family:
    """Make the family that the options describe.

    Args:
        arguments: Parsed options of the verb ``lens``.

    Returns:
        The family.

    Raises:
        LensError: An option is out of range, or the family is unknown.
    """
    shape = aperture.parse(arguments.aperture, arguments.blades, arguments.blade_angle)
    largest = LARGEST if arguments.largest is None else arguments.largest
    noise = {} if arguments.noise is None else {"noise": arguments.noise}
    if arguments.noise is not None and not 1e-5 <= arguments.noise <= 1:
        default = families.NOISE if arguments.family == "depth" else families.NOISE_JOINT
        raise LensError(f"lens: --noise {arguments.noise:g}; use 0.00001 to 1, the default is {default:g}")
    if arguments.family in ("depth-speed", "cats-eye") and not shape.round:
        raise LensError(
            f"lens bake: the family {arguments.family} has a round aperture; leave out --aperture and --blades, or "
            "give --family depth or shaped-speed"
        )
    if arguments.longest is not None and arguments.family in ("depth", "cats-eye"):
        raise LensError(
            f"lens bake: --longest is not of the family {arguments.family}, which has no motion; leave it out, or give "
            "--family depth-speed or shaped-speed"
        )
    longest = LONGEST if arguments.longest is None else arguments.longest
    if arguments.cats_eye and arguments.family != "cats-eye":
        raise LensError(f"lens bake: --cats-eye is not of the family {arguments.family}; give --family cats-eye")
    if arguments.family == "depth":
        return families.depth(largest, shape, **noise)
    if arguments.family == "depth-speed":
        return families.depth_speed(largest, longest, **noise)
    if arguments.family == "shaped-speed":
        return families.shaped_speed(largest, longest, shape, **noise)
    if arguments.family == "cats-eye":
        return families.cats_eye(largest, CATS_EYE if arguments.cats_eye is None else arguments.cats_eye, **noise)
    raise LensError(f"lens: no family {arguments.family!r}; choose {', '.join(families.NAMES)}")


def run_bake(arguments: argparse.Namespace) -> int:
    """Bake every node of a family, write the library and print a summary.

    Args:
        arguments: Parsed options of the verb ``lens``.

    Returns:
        Exit code 0.

    Raises:
        LensError: The preset is unknown, or the family has too many nodes.
        OSError: The library, or a file of ``--two-arrays``, cannot be written.
    """
    if arguments.preset not in PRESETS:
        raise LensError(f"lens: preset {arguments.preset!r}; choose {', '.join(PRESETS)}")
    family, path = family_of(arguments), Path(arguments.library)
    if family.size > MOST_NODES:
        raise LensError(
            f"lens bake: {family.size} nodes are more than {MOST_NODES}; lower --largest or --longest or raise --noise"
        )
    check_inputs_are_kept("lens bake", [("LIBRARY", path)], aperture.picture_of(arguments.aperture))
    make_folder(path.parent)
    check_writable(path)
    arrays = None if arguments.two_arrays is None else make_folder(arguments.two_arrays)
    if arrays is not None:
        check_writable(arrays / "points.npy")
    library = Library(family, LensSettings(preset=arguments.preset).recipe())
    start = time.perf_counter()
    with bars(arguments.json) as bar:
        advance = bar("bake spreadlets", family.size) if bar else (lambda n: None)
        library.nodes = bake_nodes(family, range(family.size), library.recipe, advance)
    library.save(path)
    facts = {
        "library": str(path),
        "family": family.name,
        "key": library.key(),
        "nodes": family.size,
        "spreadlets": len(library.nodes),
        "points": int(sum(len(s) for s in library.nodes.values())),
        "bytes": path.stat().st_size,
        "seconds": round(time.perf_counter() - start, 2),
    }
    if arrays is not None:
        points, ends = two_arrays(library)
        np.save(arrays / "points.npy", points)
        np.save(arrays / "counts.npy", ends)
    print(json.dumps(facts, indent=1) if arguments.json else ", ".join(f"{k} {v}" for k, v in facts.items()))
    return 0
