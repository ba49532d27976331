"""A scene that Blender has exported bakes unchanged."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

from lightwell.asset import read_fields
from lightwell.baking.pipeline import bake
from lightwell.baking.settings import BakeSettings
from lightwell.fields.budget import Budget

SCRIPT = Path(__file__).resolve().parents[2] / "benchmarks" / "lightmap_blender.py"

# Blender is one of the programs that `make test-all` is for.
pytestmark = pytest.mark.slow


def test_a_scene_exported_by_blender_bakes_unchanged(tmp_path, blender):
    room = tmp_path / "room.glb"
    subprocess.run([blender("5.0.1"), SCRIPT, "export", room], check=True, capture_output=True, timeout=300)
    small = dict(budget=Budget(1.0), views=1, view_size=(24, 16), shards=1, paths=4, steps=20)
    options = {"size": 64, "mips": 0}
    report = bake(BakeSettings(str(room), tmp_path / "out", field="lightmap", options=options, **small))
    fields, _ = read_fields(tmp_path / "out" / "scene.glb")
    assert [f.role for f in fields] == ["static"] and np.isfinite(report["psnr_db"])
    assert not any("no light of its own" in w for w in report["warnings"])


def test_cycles_finds_the_same_light(tmp_path, blender, monkeypatch):
    monkeypatch.syspath_prepend(str(SCRIPT.parent))
    from lightmap_cycles import side_by_side

    found = side_by_side(str(blender("5.0.1")), tmp_path, 64, 16, 256)
    assert found.apart < 0.2 and found.error <= found.cycles_error
