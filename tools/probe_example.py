"""Writes the probe volumes of the web tests, and what the definition answers to queries of them.

web/test/fixtures/probes.{lwp,json}: made up, with random weights, light and bricks; probe-rooms.lwp: two rooms and a
doorway, baked.

python tools/probe_example.py
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests/probes"))

from test_lattice_and_query import bricked, queries  # noqa: E402

from lightwell.probes.bake import bake_geometry  # noqa: E402
from lightwell.probes.file import read, write  # noqa: E402
from lightwell.probes.leak_scenes import two_rooms  # noqa: E402
from lightwell.probes.light import Effort, light_volume, refined  # noqa: E402
from lightwell.probes.volume import query  # noqa: E402

FIXTURES = ROOT / "web/test/fixtures"
COUNT = 1024


def main() -> None:
    """Write all three files."""
    write(bricked(), FIXTURES / "probes.lwp", "l2")
    volume = read(FIXTURES / "probes.lwp").in_air()
    x, n = queries(COUNT)
    e, z = query(volume, x, n)
    rows = [np.round(v.astype(np.float64), 7).tolist() for v in (x, n, e, z)]
    text = json.dumps(dict(zip(("place", "normal", "irradiance", "trust"), rows)), separators=(",", ":"))
    (FIXTURES / "probes.json").write_text(text + "\n")
    rooms = two_rooms(0.05, door=True).scene
    lit = light_volume(rooms, bake_geometry(rooms, 0.75, "relu-field", (0.4, 0.2, 0.6)), Effort(16, 128, 512), 1)
    parts = write(refined(rooms, lit, 1.0).volume, FIXTURES / "probe-rooms.lwp", "zh3")
    print(", ".join(f"{name} {value:.0f} B" for name, value in parts.items()), "per live probe of the rooms")


if __name__ == "__main__":
    main()
