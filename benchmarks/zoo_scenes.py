"""The scenes of benchmarks/zoo.py: every given scene and every scene of the zoo that is on this machine."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

SHARED = Path(__file__).resolve().parents[2] / "shared"
BUILT_IN = ("courtyard",)
# Kept out of all tuning: no constant was chosen with their figures in sight; but for pyraxia-hallway, whose lamps are a
# benchmark: ``WHITE`` of own light, and ``CANDIDATES`` and ``EVEN`` of emitters were chosen with it among others.
HELD_OUT = ("pyraxia-hallway", "zdm2", "veach-bidir", "needle-scanned-room")
# Looked at while working: rooms and houses, small and large, with and without a ceiling.
SUBSET = (
    "courtyard",
    "drake-living-room",
    "modern-house",
    "recast-dungeon",
    "needle-lightmap-house",
    "godot-living-room",
    "hello-webxr-hall",
    "cornell-box",
)
# Files that a folder's scene is read from, in order of preference.
PATTERNS = ("scene_mi3.xml", "scene.xml", "*decoded.glb", "*.glb", "*.gltf", "*.xml")

# Authors and licences of what the page shows.
CREDITS = {
    "bakedgi-building": "DGriffin91, MIT OR Apache-2.0",
    "bevy-barn-lamp": "Eric Chadwick, Wayfair, CC-BY 4.0",
    "bevy-cornell": "Bevy contributors, MIT OR Apache-2.0",
    "bevy-dof": "Bevy contributors, MIT OR Apache-2.0",
    "bevy-volumetric-fog": "Bevy contributors, MIT OR Apache-2.0",
    "cornell-box": "Benedikt Bitterli, CC0-1.0",
    "drake-living-room": "Toyota Research Institute; Poly Haven, CC0 1.0",
    "flowerbed-sandbox": "Meta, CC-BY 4.0",
    "gaggle-city": "DGriffin91, MIT OR Apache-2.0",
    "godot-living-room": "Godot Engine contributors, MIT",
    "godot-room": "Godot Engine contributors, MIT",
    "godot-truck-town": "Godot Engine contributors, MIT",
    "hello-webxr-hall": "Mozilla Mixed Reality, MIT",
    "japanese-bridge-garden": "kristenlee (Sketchfab), CC-BY 4.0",
    "kenney-fps-level": "Kenney, CC0 1.0",
    "lajolla-vol-cbox": "Tzu-Mao Li, MIT",
    "littlest-tokyo": "glenatron (sketchfab.com/glenatron), CC-BY-4.0",
    "living-room-2": "Jay-Artist (Mitsuba port: B. Bitterli), CC-BY-3.0",
    "modern-house": "labarch (Sketchfab), CC-BY 4.0",
    "needle-lightmap-house": "Needle Tools, MIT",
    "needle-scanned-room": "Needle Tools, MIT",
    "pyraxia-hallway": "DGriffin91, MIT OR Apache-2.0",
    "pyraxia-store": "DGriffin91, MIT OR Apache-2.0",
    "pyraxia-underwater": "DGriffin91, MIT OR Apache-2.0",
    "recast-dungeon": "Mikko Mononen, MIT",
    "room-soft-shadows": "Anex (sketchfab.com/anex), CC-BY-4.0",
    "staircase2": "NewSee2l035 (Mitsuba port: B. Bitterli), CC-BY-3.0",
    "teapots-gpu-instancing": "Takahiro; OctaneGltfExporter, MIT",
    "tile-game-room": "Poimandres, MIT",
    "two-rooms": "Simon Rodriguez, MIT",
    "veach-ajar": "Benedikt Bitterli, CC0-1.0",
    "veach-bidir": "Benedikt Bitterli, CC0-1.0",
    "vr-gallery": "Maxim Mavrichev (Sketchfab), CC-BY 4.0",
    "vulkan-subpass-scene": "Sascha Willems, Apache-2.0",
    "webxr-cave": "Immersive Web CG, MIT",
    "webxr-sound-room": "Mozilla Mixed Reality, MIT",
    "zdm2": "Cube 2: Sauerbraten map zdm2, converted by Calinou, CC-BY-4.0",
}


def scenes() -> dict[str, str]:
    """Name → what ``lightwell bake`` is given, sorted by name; scenes that are not on this machine are missing."""
    found = {name: name for name in BUILT_IN}
    folders = [f for part in ("scenes/gltf", "scenes/mitsuba", "zoo") for f in sorted((SHARED / part).glob("*/"))]
    for folder in folders:
        files = [file for pattern in PATTERNS for file in sorted(folder.rglob(pattern))]
        if files:
            found[folder.name] = str(files[0])
    return dict(sorted(found.items()))


def present(names: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Name and what ``lightwell bake`` is given, of those of some scenes that are here; prints the others."""
    found = scenes()
    for name in names:
        if name in found:
            yield name, found[name]
        else:
            print(f"{name:24} not on this machine")
