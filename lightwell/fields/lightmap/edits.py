"""The incremental bake of a light map: ``lightwell bake SCENE --field lightmap --rebake OLD``.

The atlas stays. Texels on what has changed, and those whose rays could notice it (``transport.noticed``), are traced
again; the others keep their bytes. The network, which adds the light that depends on the view, keeps its weights. An
object that is added or removed needs another atlas, and so a whole bake.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.core.formats import ARRAYS
from lightwell.core.keys import key
from lightwell.core.store import Store
from lightwell.core.work import store_of
from lightwell.fields.base import FieldSetup
from lightwell.fields.lightmap.fit import LightmapFit, LightmapPreset
from lightwell.fields.lightmap.fitting import base_picture, direction_picture
from lightwell.fields.lightmap.options import LightmapOptions, stored_as
from lightwell.fields.lightmap.sides import lit_scene
from lightwell.fields.lightmap.state import FittedLightmap, LightmapState
from lightwell.fields.lightmap.trace import AtlasIrradiance, chart, mask_image, traced_again
from lightwell.fields.protocol import Fit, Job, ReBake, Role, Shown
from lightwell.files import Arrays, prefixed, under
from lightwell.graph.pictures import Picture, encode
from lightwell.scenes.atlas import Atlas
from lightwell.scenes.parts import SceneChanges, ScenePart, scene_changes, scene_parts
from lightwell.scenes.scene import Scene
from lightwell.transport.irradiance import Irradiance
from lightwell.transport.noticed import noticed
from lightwell.transport.queries import dot, frames
from lightwell.transport.texels import Texels, texels

KEY = key("lightmap.edit", 1)
# Directions in which a texel looks for a change: there are many texels.
RAYS = 4
# Share of the paths of OLD, and fewest paths of a texel: what is traced is denoised. A lamp that moves in a Cornell
# box, against 160 paths a texel: 44 1.8 %, 22 2.2 %, 8 4.0 %.
PATHS_SHARE, FEWEST_PATHS = 0.05, 8
# What the origin of an atlas begins with whose charts were packed for the bake.
PACKED = "xatlas"
_ATLAS, _SETUP = ("uv", "chart", "first"), ("center", "half_extent", "unit", "light", "size", "matte", "relief")


@dataclass(frozen=True)
class LightmapEdit:
    """What an incremental bake starts from."""

    atlas: Atlas
    light: Irradiance
    parameters: Arrays
    """Of the network; empty without one."""
    pictures: Mapping[str, Picture]
    """Features, by name of their buffer."""
    parts: list[ScenePart]
    facts: Mapping[str, Any]
    """Preset, size, unit, seed, paths, relief, set-up, limit of bytes; JSON values."""

    @staticmethod
    def after(scene: Scene, fitted: FittedLightmap) -> LightmapEdit:
        """Make the state after a bake.

        Args:
            scene: The scene.
            fitted: Its light map of light that stands still.

        Returns:
            The state.
        """
        fit, made = fitted.map, fitted.chart
        assert made is not None
        setup = {name: getattr(fit.setup, name) for name in _SETUP}
        facts = {"preset": asdict(fit.preset), "size": fit.size, "unit": fit.unit, "seed": fit.seed, "mips": fit.mips}
        facts |= {"paths": fitted.state.paths, "relief": fit.relief, "setup": setup, "coarse": made.atlas.size}
        facts |= {"max_bytes": fitted.state.job.options.max_bytes}
        features = {n: p for n, p in fit.pictures.items() if n not in ("e", "d", "m")}
        parameters = fit.parameters if fit.preset.hidden else {}
        return LightmapEdit(made.atlas, made.light, parameters, features, scene_parts(scene), facts)

    def arrays(self) -> Arrays:
        """Return the state as it is stored.

        Returns:
            Arrays [...] by name.
        """
        pictures = {name: [p.mime, p.mips] for name, p in self.pictures.items()}
        atlas = {"size": self.atlas.size, "mips": self.atlas.mips, "origin": self.atlas.origin}
        about = {"facts": self.facts, "atlas": atlas, "pictures": pictures, "parts": [asdict(p) for p in self.parts]}
        found = prefixed("atlas", {name: getattr(self.atlas, name) for name in _ATLAS})
        found |= prefixed("light", {f.name: getattr(self.light, f.name) for f in fields(Irradiance)})
        found |= prefixed("picture", {n: np.frombuffer(p.data, np.uint8) for n, p in self.pictures.items()})
        return found | prefixed("p", self.parameters) | {"about": np.frombuffer(json.dumps(about).encode(), np.uint8)}

    @staticmethod
    def of(arrays: Arrays) -> LightmapEdit:
        """Read the state from stored arrays.

        Args:
            arrays: Result of ``arrays``.

        Returns:
            The state.

        Raises:
            ValueError: An array is missing or wrong.
        """
        try:
            about = json.loads(arrays["about"].tobytes())
            atlas = Atlas(**about["atlas"], **under("atlas", arrays))
            light, stored = Irradiance(**under("light", arrays)), under("picture", arrays)
            pictures = {n: Picture(stored[n].tobytes(), mime, mips) for n, (mime, mips) in about["pictures"].items()}
            parts = [ScenePart.of_json(part) for part in about["parts"]]
            return LightmapEdit(atlas, light, under("p", arrays), pictures, parts, about["facts"])
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"a light map that cannot be read ({error})") from None

    @property
    def preset(self) -> LightmapPreset:
        """Settings of the earlier bake."""
        values = {n: tuple(v) if isinstance(v, list) else v for n, v in self.facts["preset"].items()}
        return LightmapPreset(**values)


def kept_lightmap(job: Job) -> LightmapEdit:
    """Read the light map of an earlier bake.

    Args:
        job: Scene and settings.

    Returns:
        Its state.

    Raises:
        ValueError: OLD holds none, or the scene has other objects; one line.
    """
    old: Path = job.options.rebake
    arrays = store_of(old).find(KEY, ARRAYS)
    if arrays is None:
        raise ValueError(
            f"bake: '{old}' holds no light map of this version of lightwell to start from; "
            "bake it with --field lightmap --keep first"
        )
    try:
        before = LightmapEdit.of(arrays)
    except ValueError as error:
        raise ValueError(f"bake: '{old}' holds {error}; bake it again with --keep") from None
    first = np.cumsum([0] + [len(mesh.indices) for mesh in job.scene.meshes])
    if not np.array_equal(first, before.atlas.first):
        raise ValueError(
            f"bake: objects were added to the scene of '{old}' or removed from it, and need another atlas; "
            "bake it whole, without --rebake"
        )
    return before


def edited_chart(
    scene: Scene, before: LightmapEdit, changes: SceneChanges, paths: int
) -> tuple[AtlasIrradiance, np.ndarray]:
    """Trace again the texels that could notice what has changed.

    Args:
        scene: The scene.
        before: State of the earlier bake.
        changes: What has changed.
        paths: Paths per texel of the earlier bake, even; where many texels are traced again, each gets fewer.

    Returns:
        Atlas and irradiance, and [K] bool: texels that were traced again.
    """
    seed, covered = before.facts["seed"], texels(scene, before.atlas)
    touched = _touched(scene, covered, changes, seed)
    rows = np.flatnonzero(touched)
    each = PATHS_SHARE * paths * len(touched) / max(len(rows), 1)
    each = min(max(int(each), FEWEST_PATHS), paths) // 2 * 2

    def again(make: Any) -> Irradiance:
        if not len(rows):
            return before.light
        return traced_again(scene, before.atlas, covered, before.light, rows, each, seed + 1)

    size, mips = before.atlas.size, before.atlas.mips
    return chart(scene, size, mips, paths, seed, keep=again, atlas=before.atlas), touched


def _touched(scene: Scene, covered: Texels, changes: SceneChanges, seed: int) -> np.ndarray:
    """[K] bool: texels of changed meshes, and those that could notice a change."""
    same = changes.mesh >= 0
    touched = ~same[covered.points.shape]
    if len(changes.boxes):
        position, normal, _ = frames(scene, covered.points)
        normal = normal * np.where(dot(normal, covered.points.view) < 0, -1.0, 1.0)
        touched |= noticed(scene, position, normal, changes.boxes, changes.lamps, seed, RAYS)
    return touched


def edited_fit(scene: Scene, before: LightmapEdit, made: AtlasIrradiance) -> LightmapFit:
    """Make the light map of new irradiance and the earlier network.

    Args:
        scene: The scene.
        before: State of the earlier bake.
        made: Atlas and irradiance.

    Returns:
        The light map.
    """
    facts, preset = before.facts, before.preset
    setup = {n: tuple(v) if isinstance(v, list) else v for n, v in facts["setup"].items()}
    base = base_picture(made, facts["unit"], preset) if preset.base else None
    direction = direction_picture(made, preset.direction_reduction, preset.codec) if preset.direction else None
    mask = encode(mask_image(made), preset.codec, made.atlas.mips) if preset.base else None
    fit = LightmapFit(
        preset, facts["size"], facts["unit"], base, direction, facts["seed"],
        mips=facts["mips"], setup=FieldSetup(**setup, scene=scene), mask=mask, relief=facts["relief"],
    )  # fmt: skip
    if preset.hidden:
        # What is written is made of these two alone; the network itself is only needed to train.
        fit.parameters, fit.features = dict(before.parameters), dict(before.pictures)
    return fit


def keep_lightmap(fitted: FittedLightmap, store: Store) -> None:
    """Store what an incremental bake starts from.

    Args:
        fitted: The light map.
        store: Where to keep it.
    """
    store.put(KEY, LightmapEdit.after(fitted.state.scene, fitted).arrays(), ARRAYS)


def lightmap_changes(before: LightmapEdit, scene: Scene) -> SceneChanges:
    """Find what has changed since the earlier bake.

    Args:
        before: State of the earlier bake.
        scene: The scene.

    Returns:
        The changes.
    """
    return scene_changes(before.parts, scene_parts(scene))


def summary(job: Job, changes: SceneChanges, touched: np.ndarray, fits: Mapping[Role, Fit]) -> ReBake:
    """Summarise an incremental bake.

    Args:
        job: Scene and settings.
        changes: What has changed.
        touched: [K] texels that were traced again.
        fits: The fit of each role.

    Returns:
        The summary.
    """
    counts = {"texels": len(touched), "traced_again": int(touched.sum())}
    roles = {role: counts for role in fits}
    facts = {"from": str(job.options.rebake), "changed": list(changes.names), "roles": roles}
    facts |= {"seconds": round(job.work.elapsed, 2)}
    lines = [
        f"changed: {', '.join(changes.names) or 'nothing'}",
        f"light map: {float(np.mean(touched)) if len(touched) else 0:.1%} of the texels traced again",
    ]
    return ReBake(Shown(np.zeros(3, np.float32), np.ones(3)), facts, lines, page=True)


@dataclass
class EditedLightmap(LightmapState):
    """A scene of an incremental bake, with the light map of the earlier one."""

    before: LightmapEdit | None = None
    changes: SceneChanges | None = None
    touched: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))
    """[K] texels that were traced again."""

    def finished(self, fits: Mapping[Role, Fit]) -> ReBake:
        """Return the summary of the incremental bake.

        Args:
            fits: The fit of each role.

        Returns:
            The summary.
        """
        return summary(self.job, self.changes, self.touched, fits)


def _check_options(options: LightmapOptions, before: LightmapEdit) -> None:
    """Refuse what the earlier bake has otherwise: its atlas, its settings and its codecs stay. ``--watch`` repeats its
    own options."""
    if stored_as(before.preset, options.compress) != before.preset:
        raise ValueError("bake: --rebake stores pictures as OLD does; leave --compress out")
    mips, kept = options.mips, before.atlas.mips
    # The author's second texture coordinates may allow fewer levels than were asked for.
    fewer = mips is not None and kept < mips and not before.atlas.origin.startswith(PACKED)
    if options.size not in (None, before.facts["size"]) or not (mips in (None, kept) or fewer):
        raise ValueError("bake: --rebake keeps the atlas of OLD; leave --size and --mips out, or bake it whole")
    if options.max_bytes not in (None, before.facts.get("max_bytes")):
        raise ValueError("bake: --rebake keeps the settings of OLD; leave --max-bytes out, or bake it whole")


def edited_lightmap(job: Job) -> EditedLightmap:
    """Prepare the scene of an incremental bake.

    Args:
        job: Scene and settings.

    Returns:
        The prepared scene.

    Raises:
        ValueError: OLD cannot be started from, an option asks for another light map than OLD has, or a light varies;
            one line.
    """
    if job.request.vary:
        raise ValueError("bake: --rebake of a light map is for light that stands still; leave --vary out")
    if job.request.lamps:
        raise ValueError("bake: groups of lamps have no incremental bake yet; bake whole, or leave --lamps out")
    scene, _ = lit_scene(job.scene)
    before = kept_lightmap(job)
    _check_options(job.options, before)
    # The next incremental bake may start from this one.
    job.work.keep = True
    state = EditedLightmap(
        job,
        scene,
        None,
        ("static",),
        preset=before.preset,
        paths=before.facts["paths"],
        before=before,
        keep=keep_lightmap,
    )
    state.atlas, state.changes = before.atlas, lightmap_changes(before, scene)
    return state
