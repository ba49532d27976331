"""Animations of groups of lamps: joined from those of the lights of each group."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from lightwell.scenes.lamps import LampGroup, emitter_sources
from lightwell.scenes.light_clips import Keys, LightClip, LightPath, LightTrack
from lightwell.scenes.scene import Scene

# Names that a warning lists.
LISTED = 6


@dataclass(frozen=True)
class LampTrack:
    """Keys of the dimmer or the colour of a group."""

    lamp: int
    """Index of the group."""
    path: LightPath
    keys: Keys
    """Factors of what was baked."""


@dataclass(frozen=True)
class LampClip:
    """One animation: of groups, and of the lights and materials that other viewers show."""

    name: str
    lamps: tuple[LampTrack, ...]
    lights: tuple[LightTrack, ...]


def lamp_clips(scene: Scene, groups: Sequence[LampGroup]) -> tuple[list[LampClip], list[str]]:
    """Join the animations of a scene's lights to those of groups.

    A group follows where all its lights change alike.

    Args:
        scene: The scene that the groups were found in.
        groups: The groups that have a switch; none: nothing can follow.

    Returns:
        The animations, and warnings of what is lost.

    Raises:
        SceneError: There are groups, and the animations of the file are damaged.
    """
    names = scene.light_clips.names
    if not names:
        return [], []
    if not groups:
        plural = len(names) > 1
        return [], [
            f"{'animations' if plural else 'animation'} {_listed(names)} {'change' if plural else 'changes'} lights, "
            "which is lost: only lamps with a switch can change; bake with --lamps name"
        ]
    sources = emitter_sources(scene)
    of_group = [{sources[emitter] for emitter in group.emitters} for group in groups]
    clips: list[LampClip] = []
    split: list[str] = []
    dark: list[str] = []
    for clip in scene.light_clips.read():
        clips.append(LampClip(clip.name, tuple(_joined(clip, groups, of_group, split)), clip.tracks))
        dark += [f"'{name}' in '{clip.name}'" for name in clip.dark]
    return [clip for clip in clips if clip.lamps or clip.lights], _warnings(split, dark)


def _joined(
    clip: LightClip, groups: Sequence[LampGroup], of_group: Sequence[set[tuple[str, int]]], split: list[str]
) -> list[LampTrack]:
    """The tracks of all groups; the names of those whose lights do not change alike are appended to ``split``."""
    by_source: dict[tuple[str, int], dict[LightPath, Keys]] = {}
    for track in clip.tracks:
        for source in [("light", k) for k in track.lights] or [("material", track.material or 0)]:
            by_source.setdefault(source, {})[track.path] = track.keys
    changes = {source: _as_dimmer(found) for source, found in by_source.items()}
    joined: list[LampTrack] = []
    for number, (group, sources) in enumerate(zip(groups, of_group)):
        members = [changes.get(source, {}) for source in sources]
        paths: tuple[LightPath, ...] = ("intensity", "color")
        for path in paths:
            found = [keys for member in members if (keys := member.get(path)) is not None]
            if found and (len(found) < len(members) or not all(found[0].same(keys) for keys in found)):
                split.append(f"lamp '{group.name}' in '{clip.name}'")
            elif found:
                joined.append(LampTrack(number, path, found[0]))
    return joined


def _as_dimmer(found: Mapping[LightPath, Keys]) -> Mapping[LightPath, Keys]:
    """A colour that stays the same and only grows and falls is a dimmer."""
    grey = found["color"].grey() if "color" in found and "intensity" not in found else None
    return found if grey is None else {"intensity": grey}


def _warnings(split: Sequence[str], dark: Sequence[str]) -> list[str]:
    warnings = []
    if split:
        warnings.append(
            f"animations: {_listed(split, quoted=True)}: only some of its lights change, or not alike, so that the "
            "lamp stays as it is; group them apart with --lamps NAME=PATTERN, or animate all of them"
        )
    if dark:
        warnings.append(
            f"animations: {_listed(dark, quoted=True)}: off at rest, so that there is no light to follow; "
            "turn it on in the file, and let the animation turn it off"
        )
    return warnings


def _listed(names: Sequence[str], quoted: bool = False) -> str:
    shown = list(dict.fromkeys(name[:60] if quoted else f"'{name[:40]}'" for name in names))
    more = f" and {len(shown) - LISTED} more" if len(shown) > LISTED else ""
    return ", ".join(shown[:LISTED]) + more
