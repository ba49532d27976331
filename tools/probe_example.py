"""Writes the probe volumes of the web tests, and what the definition answers to queries of them.

web/test/fixtures/probes.{lwp,json}: made up, with random weights, light and bricks; probe-rooms.lwp: two rooms and a
doorway, baked; probe-functions.json: a file and answers for each other weight function, and for the baselines.

python tools/probe_example.py
"""

from __future__ import annotations

import base64
import json
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests/probes"))

from leak_scenes import two_rooms  # noqa: E402
from test_lattice_and_query import bricked, made_up, queries  # noqa: E402
from test_volume_files import moments  # noqa: E402

from lightwell.probes import ddgi, sh  # noqa: E402
from lightwell.probes.bake import bake_geometry  # noqa: E402
from lightwell.probes.file import decode_volume, encode_volume, read, read_baselines, write  # noqa: E402
from lightwell.probes.light import light_volume, refined  # noqa: E402
from lightwell.probes.samples import ProbeSampling  # noqa: E402
from lightwell.probes.volume import DROPPED, query  # noqa: E402
from lightwell.probes.weights import FUNCTIONS  # noqa: E402

FIXTURES = ROOT / "web/test/fixtures"
COUNT, FEW = 1024, 128


def functions() -> dict[str, dict]:
    """A file and answers of each weight function beside the first."""
    x, n = queries(FEW)
    out = {}
    for function in list(FUNCTIONS)[1:]:
        data = encode_volume(made_up(function), "l2")[0]
        e, z = query(decode_volume(data).in_air(), x, n)
        out[function] = _told(data, x, n, e, z)
    return out


def baselines() -> dict:
    """A file with baselines, and how they answer, by mode of the shader."""
    x, n = queries(FEW)
    path = FIXTURES / "probe-baselines.tmp"
    path.write_bytes(encode_volume(made_up(), "l2", baselines=moments(made_up().lattice))[0])
    data, volume, other = path.read_bytes(), read(path).in_air(), read_baselines(path)
    path.unlink()
    node, hat, _ = volume.lattice.corners(x)
    out = {}
    for mode, share in (("1", hat * ((volume.state[node] != DROPPED) & other.alive[node])), ("2", hat)):
        z = share.sum(axis=1)
        part = share / np.maximum(z, 1e-9)[:, None]
        e = np.maximum(sh.evaluate(np.einsum("nk,nkbc->nbc", part, other.light[node]), n), 0)
        out[mode] = _told(b"", x, n, e, z)
    out["3"] = _told(b"", x, n, ddgi.query(other, x, n), np.zeros(len(x)))
    return {"file": base64.b64encode(data).decode(), "modes": out}


def _told(data: bytes, *values: np.ndarray) -> dict:
    rows = [np.round(np.asarray(v, np.float64), 6).tolist() for v in values]
    names = ("place", "normal", "irradiance", "trust")
    return {"file": base64.b64encode(data).decode()} | dict(zip(names, rows))


def main() -> None:
    """Write all three files."""
    write(bricked(), FIXTURES / "probes.lwp", "l2")
    volume = read(FIXTURES / "probes.lwp").in_air()
    x, n = queries(COUNT)
    e, z = query(volume, x, n)
    rows = [np.round(v.astype(np.float64), 7).tolist() for v in (x, n, e, z)]
    text = json.dumps(dict(zip(("place", "normal", "irradiance", "trust"), rows)), separators=(",", ":"))
    (FIXTURES / "probes.json").write_text(text + "\n")
    text = json.dumps({"functions": functions(), "baselines": baselines()}, separators=(",", ":"))
    (FIXTURES / "probe-functions.json").write_text(text + "\n")
    rooms = two_rooms(0.05, door=True).scene
    lit = light_volume(rooms, bake_geometry(rooms, 0.75, "relu-field", (0.4, 0.2, 0.6)), ProbeSampling(16, 128, 512), 1)
    parts = write(refined(rooms, lit, 1.0).volume, FIXTURES / "probe-rooms.lwp", "zh3")
    print(", ".join(f"{name} {value:.0f} B" for name, value in parts.items()), "per live probe of the rooms")


if __name__ == "__main__":
    main()
