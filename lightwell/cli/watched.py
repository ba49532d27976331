"""A bake that is repeated whenever the file of its scene is saved; only what has changed is baked again."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from functools import partial
from itertools import islice
from pathlib import Path

from lightwell.baking.settings import BakeSettings
from lightwell.core.output import BAKE_FILES
from lightwell.core.scene_options import BUILTINS
from lightwell.files import files_beside

# Seconds between two looks at the files, and after which a file that does not change any more is taken to be saved.
LOOK, SETTLED = 0.5, 1.0
# Files of one scene that are looked at, at most: a file may lie in a large folder.
MOST_FILES = 2000

FileStates = tuple[tuple[str, int, int], ...]


def bake_and_watch(arguments: argparse.Namespace, asked: BakeSettings) -> int:
    """Bake, then again after each change of the scene's file; Ctrl-C ends it.

    Args:
        arguments: Parsed arguments.
        asked: Settings of the bake.

    Returns:
        Exit code.

    Raises:
        ValueError: The scene has no file.
    """
    if asked.scene in BUILTINS:
        raise ValueError(f"bake: --watch looks at a file, and '{asked.scene}' has none; name a .glb, .gltf or .xml")
    from lightwell.cli.run_bake import run_bake

    log = None if getattr(arguments, "log", None) is None else Path(arguments.log)
    look = partial(file_states, Path(asked.scene), asked.out, log)
    before = look()
    run_bake(arguments, replace(asked, keep=True))
    for _ in saves(look, before):
        started = time.perf_counter()
        try:
            arguments.started = started
            run_bake(arguments, edited(asked))
            said = f"baked again in {time.perf_counter() - started:.1f} s; reload the page"
        except (ValueError, OSError) as error:
            # A file that is half saved or cannot be lit: the next save is another chance.
            said = " ".join(str(error).split())
        print(f"lightwell: {said}", file=sys.stderr, flush=True)
    return 0


def edited(asked: BakeSettings) -> BakeSettings:
    """Return the settings of the next bake: an incremental one, where the field has it.

    Args:
        asked: Settings of the first bake.

    Returns:
        The settings.
    """
    names = {f.name for f in fields(asked.options)}
    if "rebake" not in names or "box" in names:
        return replace(asked, keep=True)
    return replace(asked, keep=True, resume=False, options=replace(asked.options, rebake=asked.out))


def saves(
    look: Callable[[], FileStates], before: FileStates, wait: Callable[[float], None] = time.sleep
) -> Iterator[FileStates]:
    """Wait for changes of a scene's files.

    Args:
        look: Reads the state of the files, as ``file_states`` does.
        before: State of its files as they were baked.
        wait: Waits for some seconds.

    Yields:
        The state of the files after each change, when they are at rest.
    """
    while True:
        wait(LOOK)
        now = look()
        if now == before or not now:
            continue
        while True:
            wait(SETTLED)
            later = look()
            if later == now:
                break
            now = later
        if now and now != before:
            before = now
            yield now


def file_states(path: Path, out: Path | None = None, log: Path | None = None) -> FileStates:
    """Read size and time of a scene's file, and of the files beside it that it may name.

    Args:
        path: File of the scene.
        out: Folder that the bake writes, which may lie beside the scene or be its folder; None: there is none.
        log: Log of the command; None: there is none.

    Returns:
        Name, bytes and time of each; empty where the file is missing for the moment. What the bake itself writes is no
        change of the scene.
    """
    try:
        found = [(path, path.stat())]
        if path.suffix.lower() != ".glb":
            written = [] if out is None else [out, *(file for pattern in BAKE_FILES for file in out.glob(pattern))]
            found += islice(files_beside(path, [*written, *filter(None, [log])]), MOST_FILES)
        return tuple((str(name), state.st_size, state.st_mtime_ns) for name, state in found) if path.is_file() else ()
    except OSError:
        return ()
