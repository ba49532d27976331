"""Reads the animations of a glTF file that change lights and emission, by KHR_animation_pointer."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from lightwell.scenes.errors import SceneError
from lightwell.scenes.gltf_accessors import Accessors
from lightwell.scenes.gltf_container import Document
from lightwell.scenes.gltf_json import Place
from lightwell.scenes.light_clips import Interpolation, Keys, LightClip, LightClips, LightPath, LightTrack

POINTER = "KHR_animation_pointer"
LIGHTS, STRENGTH = "KHR_lights_punctual", "KHR_materials_emissive_strength"
# Most animations and channels that are read, and most keys of one channel and of all.
MOST_CLIPS, MOST_CHANNELS, MOST_KEYS, MOST_KEYS_IN_ALL = 64, 1024, 1 << 16, 1 << 20
# A light that becomes brighter by more than this is off at rest (the largest dimmer of format/FORMAT.md).
MOST_FACTOR = 1e6
_NUMBER = r"(0|[1-9]\d{0,8})"
_TARGETS: tuple[tuple[re.Pattern[str], str, LightPath], ...] = (
    (re.compile(rf"/extensions/{LIGHTS}/lights/{_NUMBER}/intensity\Z"), "light", "intensity"),
    (re.compile(rf"/extensions/{LIGHTS}/lights/{_NUMBER}/color\Z"), "light", "color"),
    (re.compile(rf"/materials/{_NUMBER}/emissiveFactor\Z"), "material", "color"),
    (re.compile(rf"/materials/{_NUMBER}/extensions/{STRENGTH}/emissiveStrength\Z"), "material", "intensity"),
)
_WIDTHS: dict[LightPath, int] = {"intensity": 1, "color": 3}


@dataclass(frozen=True)
class _Target:
    """What a pointer names: a light or a material of the file, by its index, and which value of it."""

    kind: str
    index: int
    path: LightPath


def read_light_clips(
    document: Document,
    accessors: Accessors,
    lights: Mapping[int, Sequence[int]],
    materials: Mapping[int | None, int],
) -> LightClips:
    """Read the animations that change lights; a damaged one is no error before it is used.

    Args:
        document: The file.
        accessors: Its accessors.
        lights: Indices into ``Scene.lights`` by index of the file's light.
        materials: Index into ``Scene.materials`` by index of the file's material.

    Returns:
        The animations, or what is wrong with them.
    """
    animations = [document.item("animations", i) for i in range(document.count("animations"))]
    mine = [(i, animation) for i, animation in enumerate(animations) if any(_targets(animation.value))]
    names = tuple(clip_name(animation, i) for i, animation in mine)
    try:
        if len(mine) > MOST_CLIPS:
            document.fail(f"has {len(mine):,} animations of lights, more than {MOST_CLIPS}", "export fewer of them")
        reader = _Reader(document, accessors, lights, materials)
        return LightClips(names, tuple(reader.clip(animation, name) for (_, animation), name in zip(mine, names)))
    except SceneError as error:
        return LightClips(names, defect=str(error))


def changes_nodes(animation: Place) -> bool:
    """Test whether an animation has a channel that is no light's; damaged ones count as such.

    Args:
        animation: The animation.

    Returns:
        Whether it may move something.
    """
    found = list(_targets(animation.value))
    return not found or None in found


def clip_name(animation: Place, index: int) -> str:
    """Name an animation.

    Args:
        animation: The animation.
        index: Its index.

    Returns:
        Its own name, or one by its number.
    """
    return animation.text("name", "") or f"clip {index}"


def _targets(animation: dict[str, Any]) -> Iterator[_Target | None]:
    """What each channel changes, None where it is no light; whatever is damaged is no light."""
    channels = animation.get("channels")
    for channel in channels if isinstance(channels, list) else ():
        yield _target(_at(channel, "target", "extensions", POINTER, "pointer"))


def _at(value: Any, *keys: str) -> Any:
    for key in keys:
        value = value.get(key) if isinstance(value, dict) else None
    return value


def _target(pointer: Any) -> _Target | None:
    for pattern, kind, path in _TARGETS if isinstance(pointer, str) else ():
        if match := pattern.match(pointer):
            return _Target(kind, int(match[1]), path)
    return None


class _Reader:
    """Reads the channels of one file, and counts their keys."""

    def __init__(
        self,
        document: Document,
        accessors: Accessors,
        lights: Mapping[int, Sequence[int]],
        materials: Mapping[int | None, int],
    ) -> None:
        self._document, self._accessors = document, accessors
        self._lights, self._materials = lights, materials
        self._keys = 0

    def clip(self, animation: Place, name: str) -> LightClip:
        targets = list(_targets(animation.value))
        wanted = [(i, target) for i, target in enumerate(targets) if target is not None]
        if len(wanted) > MOST_CHANNELS:
            animation.fail(f"has {len(wanted):,} channels of lights, more than {MOST_CHANNELS:,}", "export fewer")
        if len({target for _, target in wanted}) < len(wanted):
            animation.fail("changes the same value by two channels")
        tracks, dark = [], []
        for i, target in wanted:
            channel = Place(animation.scene, f"{animation.what} channel {i}", animation.items("channels")[i])
            track = self._track(animation, channel, target)
            if isinstance(track, LightTrack):
                tracks.append(track)
            elif track:
                dark.append(track)
        return LightClip(name, tuple(tracks), tuple(dict.fromkeys(dark)))

    def _track(self, animation: Place, channel: Place, target: _Target) -> LightTrack | str | None:
        """The track; the name of the light where it is off at rest; None where the scene does not show it."""
        place, base = self._at_rest(target)
        keys = self._sampled(animation, channel, _WIDTHS[target.path])
        lights = tuple(self._lights.get(target.index, ())) if target.kind == "light" else ()
        material = self._materials.get(target.index) if target.kind == "material" else None
        if not lights and material is None:
            return None
        factors = _factors(keys, base)
        return (
            place.text("name", "") or place.what
            if factors is None
            else LightTrack(target.path, factors, lights, material)
        )

    def _at_rest(self, target: _Target) -> tuple[Place, np.ndarray]:
        """The light or material, and its value at rest."""
        if target.kind == "light":
            shared = self._document.root.extension(LIGHTS)
            entries = shared.items("lights") if shared else []
            if target.index >= len(entries):
                self._document.fail(f"an animation names light {target.index}, but there are {len(entries)}")
            place = Place(self._document.scene, f"light {target.index}", entries[target.index])
            if target.path == "intensity":
                return place, np.array([place.number("intensity", 1.0, low=0)])
            return place, np.array(place.numbers("color", 3, (1.0, 1.0, 1.0)))
        place = self._document.item("materials", target.index)
        if target.path == "color":
            return place, np.array(place.numbers("emissiveFactor", 3, (0.0, 0.0, 0.0)))
        strength = place.extension(STRENGTH)
        return place, np.array([strength.number("emissiveStrength", 1.0, low=0) if strength else 1.0])

    def _sampled(self, animation: Place, channel: Place, width: int) -> Keys:
        samplers = animation.items("samplers")
        number = channel.index("sampler", len(samplers), "sampler")
        if number is None:
            channel.fail("has no sampler")
        place = Place(animation.scene, f"{animation.what} sampler {number}", samplers[number])
        interpolation = place.text("interpolation", "LINEAR")
        if interpolation not in ("LINEAR", "STEP", "CUBICSPLINE"):
            place.fail(f"has interpolation '{interpolation[:20]}', expected LINEAR, STEP or CUBICSPLINE")
        per_key = 3 if interpolation == "CUBICSPLINE" else 1
        times, values = self._floats(place, "input"), self._floats(place, "output")
        fits = times.shape[1] == 1 and values.shape == (per_key * len(times), width)
        moments = times.reshape(-1)
        if not fits or not np.isfinite(moments).all() or np.any(np.diff(moments) <= 0) or moments[0] < 0:
            place.fail("has times that do not increase, or values that do not belong to them")
        if not np.isfinite(values).all():
            place.fail("has values that are not finite")
        shape = (len(times), 3, width) if per_key == 3 else (len(times), width)
        return Keys(moments, values.astype(np.float64).reshape(shape), cast(Interpolation, interpolation))

    def _floats(self, sampler: Place, key: str) -> np.ndarray:
        number = sampler.index(key, self._document.count("accessors"), "accessor")
        if number is None:
            sampler.fail(f"has no {key}")
        count = self._accessors.count(number)
        self._keys += count
        if count > 3 * MOST_KEYS or self._keys > MOST_KEYS_IN_ALL:
            sampler.fail(f"has {count:,} keys, too many: at most {MOST_KEYS:,}", "export it with fewer keys")
        return self._accessors.floats(number)


def _factors(keys: Keys, base: np.ndarray) -> Keys | None:
    """Keys relative to the value at rest; None where they turn on what is off at rest, or nearly."""
    values = keys.values.copy()
    shown = values[:, 1] if values.ndim == 3 else values
    np.maximum(shown, 0, out=shown)
    # A channel of a colour that is 0 all the time is no change: it follows the brightest one.
    off = (base <= 0) | (shown.max(axis=0) > MOST_FACTOR * np.maximum(base, 0))
    if (off & (values.reshape(-1, len(base)) != 0).any(axis=0)).any():
        return None
    with np.errstate(over="ignore"):
        factors = values / np.where(off, 1.0, base)
        if not np.isfinite(factors.astype(np.float32)).all():
            return None
    factors[..., off] = factors[..., [int(base.argmax())]]
    return Keys(keys.times, factors, keys.interpolation)
