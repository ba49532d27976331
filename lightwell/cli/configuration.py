"""``lightwell.toml``: options that need not be typed. The command line comes first, then the scene, then the verb.

[bake]                        # every bake; any option of any verb, its name without the dashes
quality = "best"
vary = ["light.position=box(-1,0,-1,1,2,1)"]

[scenes.kitchen]              # bakes of this scene only; `lightwell batch` bakes all scenes
scene = "rooms/kitchen.glb"
field = "lightmap"
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lightwell.cli.given import given_values, options_by_name, words_of
from lightwell.cli.verbs import VERBS
from lightwell.core.scene_options import BUILTINS
from lightwell.core.suggest import did_you_mean

FILE = "lightwell.toml"
# Value of --config that reads no file.
NO_FILE = "none"
# Verbs that read the tables of scenes.
SCENE_VERBS = ("bake",)
# Verbs whose target may be the settings file itself.
TARGET_VERBS = ("batch",)
# Options that cannot stand in a file: they name it, or ask for help.
_LEFT_OUT = ("config",)
# Largest file that is read, bytes.
_MOST_BYTES = 1 << 20

ParserOf = Callable[[str, Sequence[str]], argparse.ArgumentParser]
"""(verb, words after it) -> its parser."""


@dataclass(frozen=True)
class SceneTable:
    """A table ``[scenes.NAME]``."""

    name: str
    source: str
    """A built-in scene, or a path that is valid from the working folder."""
    options: Mapping[str, Any]
    """Options of ``bake`` by key, as they stand in the file."""


@dataclass(frozen=True)
class Configuration:
    """Content of a settings file."""

    path: Path
    verbs: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Options by verb and key."""
    scenes: Mapping[str, SceneTable] = field(default_factory=dict)

    def options(self, verb: str, scene: str, parser_of: ParserOf, only: str | None = None) -> dict[str, Any]:
        """Find the options of a verb for a scene.

        Args:
            verb: Name of the verb.
            scene: Name or path of the scene; empty for none.
            parser_of: Makes the parser of a verb.
            only: Name of the scene's table, of several tables of one scene; None: there must not be several.

        Returns:
            Options by name; those of the scene's table replace those of the verb's.

        Raises:
            ValueError: An option does not exist, or several tables are of this scene; one line.
        """
        found = self._options(verb, parser_of, f"[{verb}]", self.verbs.get(verb, {}))
        return found | (self.scene_options(verb, scene, parser_of, only) if verb in SCENE_VERBS and scene else {})

    def scene_options(self, verb: str, scene: str, parser_of: ParserOf, only: str | None = None) -> dict[str, Any]:
        """Find the options of the table of a scene alone.

        Args:
            verb: Name of the verb, one of ``SCENE_VERBS``.
            scene: Name or path of the scene.
            parser_of: Makes the parser of a verb.
            only: As for ``options``.

        Returns:
            Options by name; none where the scene has no table.

        Raises:
            ValueError: An option does not exist, or several tables are of this scene; one line.
        """
        own = [t for t in self.scenes.values() if only in (None, t.name) and _same(t.source, scene)]
        if len(own) > 1:
            raise ValueError(
                f"{self.path}: [scenes.{own[0].name}] and [scenes.{own[1].name}] are both of '{scene}', each with "
                f"options of its own; bake them with 'lightwell batch {self.path}', or leave the file out with "
                f"--config {NO_FILE}"
            )
        return self._options(verb, parser_of, f"[scenes.{own[0].name}]", own[0].options) if own else {}

    def _options(self, verb: str, parser_of: ParserOf, title: str, table: Mapping[str, Any]) -> dict[str, Any]:
        known = _known(verb, table, parser_of)
        return dict(_option(known, key, value, f"{self.path}: {title}") for key, value in table.items())


def add_config_option(parser: argparse._ActionsContainer) -> None:
    """Add ``--config``.

    Args:
        parser: Parser or group to add to.
    """
    parser.add_argument(
        "--config",
        metavar="FILE",
        help=f"file of options (default: {FILE} in the working folder, if there is one; {NO_FILE}: no file)",
    )


def with_configuration(verb: str, words: Sequence[str], parser_of: ParserOf) -> list[str]:
    """Add the options of the settings file to the words of a command line.

    A file that cannot be read, or holds an unknown verb or option, is a ``ValueError`` of one line with the cure.

    Args:
        verb: Name of the verb.
        words: Words after it.
        parser_of: Makes the parser of a verb.

    Returns:
        The words, then the options of the file that they do not give.
    """
    if "-h" in words or "--help" in words or not (verb in TARGET_VERBS or _may_apply(words)):
        return list(words)
    given = given_values(parser_of(verb, words), words)
    path = _chosen(given.get("config"), given.get("target") if verb in TARGET_VERBS else None)
    if path is None:
        return list(words)
    found = read_configuration(path)
    options = found.options(verb, given.get("scene") or "", parser_of)
    return [*words, *option_words(verb, options, given, path, parser_of)]


def option_words(
    verb: str, options: Mapping[str, Any], given: Container[str], path: Path, parser_of: ParserOf
) -> list[str]:
    """Write options of a file as words; those that the command line gives are left out.

    Args:
        verb: Name of the verb.
        options: Options by name, as ``Configuration.options`` returns them.
        given: Names of the options that the command line gives.
        path: The file, for messages.
        parser_of: Makes the parser of a verb.

    Returns:
        Words.

    Raises:
        ValueError: An option has a value of another kind; one line.
    """
    known, found = _known(verb, options, parser_of), []
    for name, value in options.items():
        if name in given:
            continue
        try:
            found += words_of(known[name], value)
        except ValueError as error:
            raise ValueError(f"{path}: option '{name}' of {verb} {error}") from None
    return found


def read_configuration(path: Path) -> Configuration:
    """Read a settings file and check the names of its tables.

    Args:
        path: The file.

    Returns:
        Its content.

    Raises:
        ValueError: The file is not TOML, or holds an unknown table; one line with the cure.
    """
    tables = _read(path)
    for name, table in tables.items():
        if name not in (*VERBS, "scenes"):
            cure = did_you_mean(name, (*VERBS, "scenes"), "write [VERB], such as [bake], or [scenes.NAME]")
            raise ValueError(f"{path}: there is no table [{name}]; {cure}")
        if not isinstance(table, dict):
            raise ValueError(f"{path}: '{name}' is no table; write [{name}] and its options below")
    scenes = {name: _scene(path, name, table) for name, table in tables.pop("scenes", {}).items()}
    return Configuration(path, tables, scenes)


def _may_apply(words: Sequence[str]) -> bool:
    # Options may be shortened.
    return Path(FILE).is_file() or any(word.startswith("--c") for word in words)


def _chosen(asked: str | None, target: str | None) -> Path | None:
    if target and Path(target).is_file():
        if asked not in (None, NO_FILE):
            raise ValueError(f"--config: '{target}' is the settings file of this batch; leave --config out")
        return Path(target)
    if asked == NO_FILE:
        return None
    path = Path(asked or FILE)
    if asked and not path.is_file():
        raise ValueError(f"--config: there is no file '{asked}'; check the path, or leave --config out")
    return path if path.is_file() else None


def _read(path: Path) -> dict[str, Any]:
    if sys.version_info >= (3, 11):
        import tomllib
    else:
        import tomli as tomllib
    if path.stat().st_size > _MOST_BYTES:
        raise ValueError(f"{path}: is larger than 1 MB; settings are a few lines, name another file with --config")
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())[:160]
        raise ValueError(f"{path}: is not TOML ({reason}); correct that line") from None


def _scene(path: Path, name: str, table: Any) -> SceneTable:
    if not isinstance(table, dict):
        raise ValueError(f"{path}: [scenes] {name} is no table; write [scenes.{name}] and its options below")
    options = dict(table)
    source = options.pop("scene", None)
    if not isinstance(source, str):
        raise ValueError(f'{path}: [scenes.{name}] has no scene; add the line scene = "FILE.glb"')
    if source not in BUILTINS:
        source = str(path.parent / source)
    return SceneTable(name, source, options)


def _known(verb: str, options: Mapping[str, Any], parser_of: ParserOf) -> dict[str, argparse.Action]:
    """Options of a verb by name; those of a field of another distribution are known where it is chosen."""
    chosen = options.get("field")
    return options_by_name(parser_of(verb, ["--field", chosen] if isinstance(chosen, str) else []))


def _same(source: str, other: str) -> bool:
    """Whether two names mean the same scene."""
    if source in BUILTINS or other in BUILTINS:
        return source == other
    return Path(source).resolve() == Path(other).resolve()


def _option(known: Mapping[str, argparse.Action], key: str, value: Any, where: str) -> tuple[str, Any]:
    """(name, value) of an option of a file; a switch may be written by its name or by its flag."""
    name = key.replace("-", "_")
    if name in known and name not in _LEFT_OUT:
        return name, value
    for other, action in known.items():
        if f"--{name.replace('_', '-')}" in action.option_strings and other not in _LEFT_OUT:
            return other, (value == action.const) if action.nargs == 0 and isinstance(value, bool) else value
    names = [other.replace("_", "-") for other in known if other not in _LEFT_OUT]
    cure = did_you_mean(key, names, "its options are those of --help without the dashes")
    raise ValueError(f"{where} there is no option '{key}'; {cure}")
