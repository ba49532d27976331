"""The verb ``batch``."""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from lightwell.baking.settings import BakeSettings
from lightwell.cli.bake import add_bake_options
from lightwell.cli.configuration import FILE, NO_FILE, Configuration, option_words, read_configuration
from lightwell.cli.given import given_values, options_by_name, words_of
from lightwell.core.scene_options import SCENE_SUFFIXES, check_source

DESCRIPTION = """\
lightwell batch lightwell.toml -o OUT   bake every scene of the file, each with its options
lightwell batch FOLDER -o OUT           bake every scene file in a folder
writes
  OUT/batch.html, OUT/batch.json   one report of all scenes
  OUT/NAME/                        what bake writes, for each scene
The same command goes on where an interrupted one was: finished scenes whose files and options have not changed are
kept. A scene that fails does not end the batch. Options of bake that are given here hold for every scene."""
# Options that belong to the batch, not to its bakes.
OWN = (
    "out", "json", "config", "log", "force", "resume", "target",
    # Of a bake that somebody looks at: it would wait for saves, or for Ctrl-C.
    "preview", "watch", "port", "no_open",
)  # fmt: skip
# Names that are folders on every system.
_NAME = re.compile(r"[\w][\w .-]*")


def add(parser: argparse.ArgumentParser, argv: Sequence[str]) -> None:
    """Add the arguments.

    Args:
        parser: Parser of the verb.
        argv: Words after the verb.
    """
    parser.add_argument("target", metavar="FILE|FOLDER", help=f"a {FILE} with scenes, or a folder of scene files")
    parser.add_argument("-o", "--out", help="folder to write (default: batch)")
    add_bake_options(parser, argv)


def run(arguments: argparse.Namespace) -> int:
    """Bake all scenes.

    Args:
        arguments: Parsed arguments.

    Returns:
        Exit code: 1 where a scene failed.
    """
    out, scenes = _scenes(arguments)
    from lightwell.baking.batch import FAILED, BatchScene, BatchSettings, batch
    from lightwell.cli.child import run_child
    from lightwell.core.progress import Progress

    made = tuple(BatchScene(name, source, Path(folder), words) for name, (source, folder, words) in scenes.items())
    aside = tuple(Path(name) for name in (arguments.target, arguments.config or FILE, arguments.log) if name)
    settings = BatchSettings(out, made, hasattr(arguments, "force"), aside)
    numbers = batch(settings, run_child, Progress(quiet=arguments.json))
    if arguments.json:
        print(json.dumps(numbers, indent=1))
    return int(any(row["state"] == FAILED for row in numbers["scenes"]))


def _scenes(arguments: argparse.Namespace) -> tuple[Path, dict[str, Any]]:
    """Folder of the batch; name -> (source, folder, words) of every scene, checked before the first one is baked."""
    from lightwell.cli.main import verb_parser

    target = Path(arguments.target)
    found = _configuration(target, arguments.config)
    sources = _sources(target, found)
    known = options_by_name(verb_parser("bake", arguments.typed))
    given = given_values(verb_parser("batch", arguments.typed), arguments.typed)
    said = {name: value for name, value in given.items() if name in known and name not in OWN}
    # Options of every scene: [bake], then [batch], which the table of a scene replaces.
    of_all = found.options("bake", "", verb_parser)
    of_all |= {name: v for name, v in found.options("batch", "", verb_parser).items() if name not in OWN}
    words = [word for name, value in said.items() for word in words_of(known[name], value)]
    out = Path(arguments.out or found.verbs.get("batch", {}).get("out", "batch"))
    scenes: dict[str, Any] = {}
    for name, source in sources.items():
        check_source(source)
        # Of a settings file each table is a scene of its own, also where several name one file.
        options = of_all | found.scene_options("bake", source, verb_parser, name if target.is_file() else None)
        folder = options.pop("out", out / name)
        own = [*option_words("bake", options, {*said, *OWN}, found.path, verb_parser), *words]
        _check(verb_parser("bake", own), [source, f"--out={folder}", *own])
        scenes[name] = (source, folder, tuple(own))
    _check_folders({name: Path(folder) for name, (_, folder, _) in scenes.items()})
    return out, scenes


def _check_folders(folders: Mapping[str, Path]) -> None:
    """Refuse scenes that would overwrite each other."""
    first: dict[Path, str] = {}
    for name, folder in folders.items():
        other = first.setdefault(folder.resolve(), name)
        if other != name:
            raise ValueError(
                f"batch: scenes '{other}' and '{name}' have one folder, '{folder}'; give each an out of its own, or "
                "leave out both"
            )


def _check(parser: argparse.ArgumentParser, words: list[str]) -> None:
    """Refuse a wrong option of a scene before anything is baked."""
    from lightwell.cli import bake
    from lightwell.cli.early import check_arguments

    arguments = parser.parse_args(words)
    check_arguments(arguments)
    asked: BakeSettings = bake.settings(arguments)
    del asked


def _configuration(target: Path, asked: str | None) -> Configuration:
    """The settings file of a batch: the target, or that of the working folder; a folder of scenes may be foreign."""
    if target.is_file():
        return read_configuration(target)
    if not target.is_dir():
        raise ValueError(f"batch: there is no '{target}'; name a {FILE} with scenes, or a folder of scene files")
    if asked == NO_FILE:
        return Configuration(Path(FILE))
    path = Path(asked or FILE)
    return read_configuration(path) if path.is_file() else Configuration(path)


def _sources(target: Path, found: Configuration) -> dict[str, str]:
    """Name -> source of every scene."""
    if target.is_dir():
        files = sorted(path for path in target.iterdir() if path.suffix.lower() in SCENE_SUFFIXES)
        stems = [path.stem for path in files]
        sources = {p.stem if stems.count(p.stem) == 1 else p.name: str(p) for p in files}
    else:
        sources = {table.name: table.source for table in found.scenes.values()}
    if not sources:
        cure = "add tables [scenes.NAME]" if target.is_file() else f"it has no {', '.join(SCENE_SUFFIXES)} file"
        raise ValueError(f"batch: '{target}' names no scene; {cure}")
    for name in sources:
        if not _NAME.fullmatch(name) or name == "logs":
            raise ValueError(f"batch: '{name}' cannot be the name of a folder; rename it (letters, digits, '.', '-')")
    return sources
