"""Whether the results of all fields, on fixed seeds and plans, have the bytes that they had.

    python benchmarks/field_bytes.py [--only factored,lightmap] [--quick]
    python benchmarks/field_bytes.py --record "what changed on purpose"

Bakes the built-in Cornell box with each field, at a size of seconds, and compares the SHA-256 sums of the written files
with those in benchmarks/field_bytes.json. ``--record`` stores the new sums, and the reason beside the fields that it
changed. Another processor or another version of Mitsuba rounds differently: compare on the machine that recorded them.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from rows import Row, at_least, chosen, publish

import lightwell
from lightwell.doctor import machine, version_of
from lightwell.fields.registry import BUILT_IN
from lightwell.files import write_atomically

STORE = Path(__file__).with_suffix(".json")
# Everything that a plan or a clock would choose otherwise.
PLAN = {"seed": 3, "shards": 1, "steps": 12, "paths": 4, "views": 1, "view_size": (28, 18), "truth": "0.1s"}
OWN: dict[str, dict[str, Any]] = {"probes": {"preset": "draft"}, "lightmap": {"size": 64}, "transfer": {}}
# What is learned; reports and pages hold times.
LEARNED = (".glb", ".lwp", ".npz", ".exr", ".ktx2", ".png")


def sums(field: str, out: Path) -> dict[str, str]:
    """Bake a field and sum what it wrote.

    Args:
        field: Name of the field.
        out: Folder to write.

    Returns:
        File to its SHA-256 sum.
    """
    lightwell.bake("cornell", out, field=field, **PLAN, **OWN.get(field, {}))
    files = sorted(path for path in out.rglob("*") if path.suffix in LEARNED and ".lightwell" not in path.parts)
    return {str(path.relative_to(out)): _sum(path) for path in files}


def _sum(path: Path) -> str:
    """Of the arrays of an archive, whose members carry the time."""
    if path.suffix != ".npz":
        return hashlib.sha256(path.read_bytes()).hexdigest()
    with np.load(path) as arrays:
        return hashlib.sha256(b"".join(name.encode() + arrays[name].tobytes() for name in sorted(arrays))).hexdigest()


def record(found: dict[str, dict[str, str]], reason: str) -> None:
    """Store sums, and why they changed.

    Args:
        found: Field to the sums of its files.
        reason: What changed on purpose.
    """
    stored = json.loads(STORE.read_text())
    changed = [field for field, files in found.items() if stored["fields"].get(field) != files]
    stored["machine"] = f"{machine()}, Mitsuba {version_of('mitsuba')}"
    stored["fields"] |= found
    if changed:
        stored["changed on purpose"].append({"fields": changed, "reason": reason})
    write_atomically(STORE, json.dumps(stored, indent=1) + "\n")
    print(f"recorded {', '.join(changed) or 'nothing new'}")


def compared(found: dict[str, dict[str, str]]) -> Row:
    """Compare sums with the stored ones.

    Args:
        found: Field to the sums of its files.

    Returns:
        A row; its note names the fields that differ.
    """
    stored = json.loads(STORE.read_text())
    other = [field for field, files in found.items() if stored["fields"].get(field) != files]
    note = f"differ: {', '.join(other)}" if other else f"recorded on {stored['machine']}"
    return at_least(
        "results: fields that have the stored bytes on fixed seeds and plans",
        len(found),
        len(found) - len(other),
        "fields",
        note,
    )


def main() -> None:
    """Bake, compare, print; or record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", help=f"some of {', '.join(BUILT_IN)}")
    parser.add_argument("--quick", action="store_true", help="print, write nothing")
    parser.add_argument("--record", metavar="REASON", help="store the sums instead of comparing them")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        fields = chosen("--only", given.only, BUILT_IN)
        found = {field: sums(field, Path(folder) / field) for field in fields}
    if given.record:
        record(found, given.record)
    else:
        publish("architecture", [compared(found)], given.quick or given.only is not None)


if __name__ == "__main__":
    main()
