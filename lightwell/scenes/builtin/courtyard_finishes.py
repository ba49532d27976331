"""Materials of the courtyard house: limewashed brick, plaster, polished concrete, oak, terracotta, teal and yellow."""

from __future__ import annotations

from typing import Any

from ..scene import Image, Material, Texture
from . import patterns
from .kit import Kit


def _matt(name: str, image: Image, roughness: float = 0.9, **more: Any) -> Material:
    """A textured dielectric."""
    texture = Texture(image)
    return Material(name, base_color_texture=texture, metallic=0.0, roughness=roughness, **more)


def _plain(
    name: str, color: tuple[float, float, float], roughness: float = 0.8, metallic: float = 0.0, **more: Any
) -> Material:
    """A dielectric (or metal) of one linear colour."""
    return Material(name, base_color=(*color, 1.0), metallic=metallic, roughness=roughness, **more)


def register(kit: Kit) -> None:
    """Register every material of the house.

    Args:
        kit: Kit of the scene; changed.
    """
    _walls(kit)
    _floors(kit)
    _objects(kit)
    _pictures(kit)


def _walls(kit: Kit) -> None:
    brick = patterns.brick((0.60, 0.47, 0.37), (0.82, 0.71, 0.59), (0.77, 0.72, 0.65))
    relief = Texture(patterns.brick_normals())
    kit.material(_matt("brick", brick, normal_texture=relief), patterns.BRICK_TILE)
    plaster = patterns.plaster((0.86, 0.84, 0.80))
    kit.material(_matt("plaster", plaster), 2.2)
    kit.material(_matt("concrete", patterns.plaster((0.50, 0.49, 0.475), seed=35, contrast=1.8), 0.8), 1.1)
    kit.material(_matt("terracotta", patterns.plaster((0.80, 0.51, 0.37), seed=25, contrast=1.6)), 2.2)
    kit.material(_matt("ink", patterns.plaster((0.22, 0.30, 0.36), seed=27, contrast=1.6)), 2.2)
    kit.material(_plain("ceiling", (0.78, 0.77, 0.74), 0.95))


def _floors(kit: Kit) -> None:
    color = patterns.concrete_tiles((0.55, 0.535, 0.51), (0.33, 0.35, 0.335))
    polish = Texture(patterns.concrete_tiles_roughness(0.14, 0.24))
    tiles = Material(
        "tiles", base_color_texture=Texture(color), metallic=0.0, roughness=1.0, metallic_roughness_texture=polish
    )
    kit.material(tiles, patterns.TILES_SIZE)
    boards = patterns.wood((0.50, 0.35, 0.22), (0.74, 0.58, 0.41), planks=8)
    kit.material(_matt("oak_floor", boards, 0.45), 1.2)


def _objects(kit: Kit) -> None:
    kit.material(_matt("oak", patterns.wood((0.50, 0.34, 0.21), (0.76, 0.59, 0.40), seed=43), 0.5), 0.8)
    kit.material(_matt("teal", patterns.plaster((0.12, 0.38, 0.39), seed=29), 0.4), 1.0)
    kit.material(_matt("yellow", patterns.cloth((0.90, 0.69, 0.20), stripe=(0.93, 0.88, 0.74)), 1.0), 0.5)
    kit.material(_matt("linen", patterns.cloth((0.86, 0.83, 0.77), seed=55), 1.0), 0.4)
    kit.material(_matt("clay", patterns.plaster((0.72, 0.44, 0.31), seed=33, contrast=1.4), 0.85), 0.8)
    leaf = patterns.leaf_blade((0.20, 0.42, 0.18), (0.55, 0.66, 0.38))
    kit.material(_matt("leaf", leaf, 0.45, double_sided=True), 1.0)
    kit.material(_plain("stem", (0.12, 0.19, 0.06), 0.7))
    kit.material(_plain("soil", (0.06, 0.042, 0.03), 1.0))
    kit.material(_plain("celadon", (0.38, 0.52, 0.46), 0.25))
    kit.material(_plain("steel", (0.09, 0.09, 0.095), 0.45))
    kit.material(_plain("book_red", (0.42, 0.10, 0.06)))
    kit.material(_plain("book_cream", (0.66, 0.58, 0.44)))
    kit.material(_plain("book_blue", (0.08, 0.16, 0.28)))


def _pictures(kit: Kit) -> None:
    paper = (0.93, 0.91, 0.86)
    inks = {
        "sun": ((0.86, 0.42, 0.24), (0.16, 0.38, 0.42), (0.90, 0.72, 0.33)),
        "hills": ((0.80, 0.84, 0.80), (0.50, 0.63, 0.62), (0.22, 0.42, 0.45), (0.12, 0.22, 0.28)),
        "arches": ((0.18, 0.36, 0.40), (0.92, 0.83, 0.66), (0.82, 0.44, 0.28), (0.93, 0.74, 0.36)),
    }
    for kind, colors in inks.items():
        kit.material(_matt(f"painting_{kind}", patterns.painting(kind, paper, colors), 0.7))
