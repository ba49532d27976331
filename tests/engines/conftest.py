"""A bake with a light map and probes, and its export to every engine."""

import shutil
from pathlib import Path

import pytest

from lightwell.engines import ENGINES, export_engine

FIXTURES = Path(__file__).parents[2] / "web/test/fixtures"


@pytest.fixture(scope="session")
def bake_folder(tmp_path_factory) -> Path:
    """A folder as a bake writes it: two squares with a light map, and probes of another room."""
    folder = tmp_path_factory.mktemp("bake")
    shutil.copy(FIXTURES / "lightmap.glb", folder / "scene.glb")
    shutil.copy(FIXTURES / "probes.lwp", folder / "probes-static.lwp")
    return folder


@pytest.fixture(scope="session")
def exported(bake_folder, tmp_path_factory):
    """Call with the name of an engine: the folder of its files, written once."""
    made = {}

    def folder(engine: str) -> Path:
        if engine not in made:
            made[engine] = tmp_path_factory.mktemp(engine)
            export_engine(bake_folder, engine, made[engine])
        return made[engine]

    assert set(ENGINES) == {"godot", "unity", "unreal", "playcanvas", "babylon", "bevy", "threejs"}
    return folder
