"""The functions of ``import lightwell``: one call for each thing that the command line does, with the same options."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lightwell.asset.records import FieldEntry
    from lightwell.cache import RadianceCache
    from lightwell.probes.volume import ProbeVolume

PathLike = str | os.PathLike[str]


@dataclass(frozen=True)
class Written(Mapping[str, Any]):
    """What a command has written: a folder, and numbers that are read like a dictionary."""

    folder: Path
    """Folder that was written."""
    numbers: Mapping[str, Any]
    """Content of the JSON file with the numbers."""

    def __getitem__(self, key: str) -> Any:
        return self.numbers[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self.numbers)

    def __len__(self) -> int:
        return len(self.numbers)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.folder}, {len(self.numbers)} entries>"


class Report(Written):
    """What a bake achieved: the numbers of ``report.json`` (``rebake.json`` where only a part was baked again)."""

    def __repr__(self) -> str:
        return f"<Report {self.folder}: {self.verdict}>"

    @property
    def verdict(self) -> str:
        """One sentence on how good the bake is."""
        return self.numbers.get("verdict") or "not judged"

    @property
    def asset(self) -> Path:
        """The glTF file with the learned light."""
        return self.folder / "scene.glb"

    @property
    def page(self) -> Path:
        """The page in which one orbits and moves the light."""
        return self.folder / "index.html"

    @property
    def html(self) -> Path:
        """The report with pictures and charts."""
        return self.folder / "report.html"

    def _repr_html_(self) -> str:
        """The verdict, learned light beside the reference, and the main figures, for notebooks."""
        from lightwell.core.notebook import card
        from lightwell.report.cards import cards
        from lightwell.report.html import first_pictures

        rows = [(c.term, c.value, c.why) for c in cards(self.numbers)] if "previous" in self.numbers else []
        title = self.numbers.get("scene", self.folder.name)
        return card(title, rows, text=self.verdict, pictures=first_pictures(self.html))


class Comparison(Written):
    """What a comparison of fields found: the numbers of ``compare.json``; each field has a folder of its own."""

    @property
    def html(self) -> Path:
        """The comparison with table, charts and pictures."""
        return self.folder / "compare.html"

    def _repr_html_(self) -> str:
        """The fields as a table, best first, with their pictures, for notebooks."""
        from lightwell.baking.comparison import COLUMNS
        from lightwell.baking.side_by_side import cells
        from lightwell.core.notebook import card
        from lightwell.report.html import first_pictures

        ranked = sorted(self.numbers["fields"], key=lambda field: field["relative_error"])
        headings, *rows = cells(ranked, COLUMNS)
        pictures: dict[str, str] = {}
        for field in ranked:
            found = first_pictures(self.folder / field["folder"] / "report.html")
            pictures |= {name if name == "reference" else field["name"]: source for name, source in found.items()}
        return card(self.numbers["scene"], rows, headings=headings, pictures=pictures)


@dataclass(frozen=True)
class Asset:
    """The learned light of a glTF file."""

    path: Path
    """The file."""
    fields: Sequence[FieldEntry]
    """Its fields, each with its shading graph; see ``lightwell.graph.evaluate``."""
    variables: Sequence[Mapping[str, Any]]
    """What may move at run time, as the extension's JSON says it."""

    def __repr__(self) -> str:
        return f"<Asset {self.path}: {', '.join(map(repr, self.fields)) or 'no fields'}>"

    def _repr_html_(self) -> str:
        """The fields, with the pictures of the report that lies beside the file, for notebooks."""
        from lightwell.core.notebook import card
        from lightwell.report.html import first_pictures

        rows = [row for field in self.fields for row in field.rows()]
        return card(self.path.name, rows, pictures=first_pictures(self.path.with_name("report.html")))


def bake(scene: PathLike, out: PathLike, *, progress: bool = False, **options: Any) -> Report:
    """Learn the indirect light of a scene; write a glTF that carries it, a page and a report.

    Args:
        scene: Path of a glTF, USD, OBJ, PLY, Blender or Mitsuba .xml file, or 'cornell', 'courtyard', 'courtyard-day',
            'doorway', 'loft' or 'two-rooms'.
        out: Folder to write.
        progress: Show bars on standard error.
        **options: Those of ``lightwell bake``, as fields of ``BakeSettings`` (``budget='5m'``, ``seed=1``,
            ``vary=['light.radius=0.02']``), and those of the chosen field (``field='lightmap', size=512``).

    Returns:
        The report: relative errors are fractions, PSNR is in decibels, sizes are in bytes, times in seconds.

    Raises:
        ValueError: A mistake in the arguments or the scene; one line with the cure.
        OSError: A file cannot be read or written.

    Example:
        >>> report = lightwell.bake("cornell", "out/box", steps=50, shards=1, views=1)
        >>> report["relative_error"] > 0
        True
    """
    from lightwell.baking.pipeline import bake as run
    from lightwell.baking.settings import BakeSettings

    settings = BakeSettings(**read_settings(BakeSettings, scene, out, options, own="options"))
    return Report(Path(out), run(settings, _progress(progress)))


def compare(
    scene: PathLike, out: PathLike, fields: str | Sequence[str], *, progress: bool = False, **options: Any
) -> Comparison:
    """Train several fields on the same samples and score them against the same reference.

    Args:
        scene: As in ``bake``.
        out: Folder to write.
        fields: Fields and presets: 'mlp,mlp:report-20' or ['mlp', 'mlp:report-20'].
        progress: Show bars on standard error.
        **options: Those of ``lightwell compare``, such as ``budget='60s'``.

    Returns:
        The comparison; ``['fields']`` holds the figures of each field.

    Raises:
        ValueError: A mistake in the arguments or the scene, or no field could be trained; one line with the cure.
        OSError: A file cannot be read or written.

    Example:
        >>> found = lightwell.compare("cornell", "out/fields", "mlp,tree", steps=20, shards=1)
        >>> [field["name"] for field in found["fields"]]
        ['mlp', 'tree']
    """
    from lightwell.baking.comparison import CompareSettings, compare_fields, parse_fields

    names = fields if isinstance(fields, str) else ",".join(fields)
    settings = CompareSettings(
        fields=parse_fields(names), **read_settings(CompareSettings, scene, out, options, verb="compare")
    )
    return Comparison(Path(out), compare_fields(settings, _progress(progress)))


def render(scene: PathLike, out: PathLike, *, progress: bool = False, **options: Any) -> dict[str, Any]:
    """Render a picture of a scene by path tracing or with the radiance cache.

    Args:
        scene: As in ``bake``.
        out: Picture to write: .png is tone-mapped sRGB, .exr is linear radiance [H, W, 3]; a folder for a sequence.
        progress: Show how far a sequence is.
        **options: Those of ``lightwell render``: ``size=(640, 400)`` in pixels, ``spp``, ``camera``, ``light`` in
            metres, ``intensity`` in candela, ``integrator='nrc'`` and its options.

    Returns:
        What was rendered: size in pixels, paths per pixel, light, mean radiance, seconds.

    Raises:
        ValueError: A mistake in the arguments or the scene; one line with the cure.
        OSError: A file cannot be read or written.

    Example:
        >>> lightwell.render("cornell", "out/box.png", size=(64, 40), spp=4)["width"]
        64
    """
    from lightwell.rendering.integrators import render as run
    from lightwell.rendering.settings import RenderSettings

    settings = RenderSettings(**read_settings(RenderSettings, scene, out, options, verb="render", own="options"))
    return run(settings, quiet=not progress)


def samples(scene: PathLike, out: PathLike, **options: Any) -> dict[str, Any]:
    """Path-trace samples of a scene's indirect light into an .npz of plain arrays.

    Args:
        scene: As in ``bake``.
        out: File to write, .npz; ``lightwell.baking.sample_file.write_samples`` says what its columns are.
        **options: Those of ``lightwell samples``: ``samples``, ``vary``, ``paths``, ``seed``, ``own_light``.

    Returns:
        Facts about the file.

    Raises:
        ValueError: A mistake in the arguments or the scene; one line with the cure.
        OSError: The file cannot be written.

    Example:
        >>> lightwell.samples("cornell", "out/samples.npz", samples=256)["samples"]
        256
    """
    from lightwell.baking.sample_file import SampleSettings, write_samples

    return write_samples(SampleSettings(**read_settings(SampleSettings, scene, out, options, verb="samples")))


def read(path: PathLike) -> Asset | ProbeVolume | RadianceCache:
    """Read what lightwell has written.

    Args:
        path: A folder that ``bake`` wrote or a .glb (learned light), a .lwp (light probes), or an .npz that
            ``RadianceCache.save`` wrote.

    Returns:
        The fields of the asset, the probe volume, or the radiance cache.

    Raises:
        ValueError: The file is none of these, or is damaged; one line.
        OSError: The file cannot be read.

    Example:
        >>> [field.role for field in lightwell.read("out/box").fields]
        ['indirect']
    """
    target = Path(path)
    target = target / "scene.glb" if target.is_dir() else target
    suffix = target.suffix.lower()
    if suffix == ".glb":
        from lightwell.asset.read import read_fields

        return Asset(target, *read_fields(target))
    if suffix == ".lwp":
        from lightwell.probes.file import read as read_probes

        return read_probes(target)
    if suffix == ".npz":
        from lightwell.cache import RadianceCache

        return RadianceCache.load(target)
    raise ValueError(f"read: '{path}' is no folder of a bake, .glb, .lwp or .npz; name what lightwell has written")


# ---------------------------------------------------------------------- arguments


def read_settings(
    kind: Any, scene: PathLike, out: PathLike, options: Mapping[str, Any], verb: str = "bake", own: str = ""
) -> dict[str, Any]:
    """Make the arguments of a class of settings from keyword arguments; texts are read as on the command line.

    Args:
        kind: Dataclass of the settings.
        scene: Its scene.
        out: What is written.
        options: Values by name.
        verb: Verb of the command line, for messages.
        own: Name under which options are passed on that the class does not have, those of a field or integrator;
            '': there are none.

    Returns:
        Arguments by name.

    Raises:
        ValueError: The class has no such option and passes none on, or a text cannot be read.
    """
    from lightwell.core.options import flag_of, options_of, parsed

    known, readers = {f.name for f in fields(kind)}, options_of(kind)
    given: dict[str, Any] = {"scene": os.fspath(scene), "out": Path(out)}
    rest: dict[str, Any] = {}
    for name, value in options.items():
        if name not in known and not own:
            raise ValueError(f"{verb}: there is no option '{name}'; it has {', '.join(sorted(known - set(given)))}")
        (given if name in known else rest)[name] = value
    for name, (_, option) in readers.items():
        if isinstance(given.get(name), str) and option.parse is not None:
            given[name] = parsed(verb, flag_of(name, option), given[name], option.parse)
        elif option.repeat and isinstance(given.get(name), list):
            given[name] = tuple(given[name])
    if rest:
        given[own] = dict(given.get(own) or {}) | rest
    return given


def _progress(shown: bool) -> Any:
    from lightwell.core.progress import Progress

    return Progress(quiet=not shown)
