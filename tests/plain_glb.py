"""Writes a scene as a .glb that can be loaded again: with a field that is black everywhere, because a file has one."""

from pathlib import Path

from lightwell.asset.records import FieldEntry
from lightwell.asset.write import write_glb
from lightwell.fields.features import open_builder
from lightwell.scenes.scene import Scene


def write_plain(path: Path, scene: Scene) -> None:
    """Write the surfaces and lights of a scene."""
    b = open_builder()
    graph = b.build(radiance=b.scale("reflectance", 0.0))
    write_glb(path, scene, [FieldEntry("none", "static", graph)], [])
