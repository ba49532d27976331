"""The scenes of benchmarks/zoo.py: every given scene and every scene of the zoo that is on this machine."""

from __future__ import annotations

from pathlib import Path

SHARED = Path(__file__).resolve().parents[2] / "shared"
BUILT_IN = ("courtyard",)
# Kept out of all tuning: no constant was chosen with their figures in sight.
HELD_OUT = ("pyraxia-hallway", "webxr-cave", "veach-bidir", "needle-scanned-room")
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


def scenes() -> dict[str, str]:
    """Name → what ``lightwell bake`` is given, sorted by name; scenes that are not on this machine are missing."""
    found = {name: name for name in BUILT_IN}
    folders = [f for part in ("scenes/gltf", "scenes/mitsuba", "zoo") for f in sorted((SHARED / part).glob("*/"))]
    for folder in folders:
        files = [file for pattern in PATTERNS for file in sorted(folder.rglob(pattern))]
        if files:
            found[folder.name] = str(files[0])
    return dict(sorted(found.items()))
