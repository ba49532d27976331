"""The verb ``store``: information about the files that lightwell keeps between runs, and their removal."""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from collections.abc import Sequence
from typing import Any

from lightwell.core.units import size_text

DESCRIPTION = """\
lightwell keeps what is expensive to make, such as libraries of the lens, in one folder: LIGHTWELL_STORE, else the
platform's folder for caches. Beyond 20 GB (or LIGHTWELL_STORE_LIMIT) what was not used for longest is removed."""


def add(parser: argparse.ArgumentParser, argv: Sequence[str]) -> None:
    """Add the arguments.

    Args:
        parser: Parser of the verb.
        argv: Words after the verb.
    """
    parser.add_argument("action", choices=("info", "clear"), help="info: what it holds; clear: remove all of it")
    parser.add_argument("--json", action="store_true", help="print the facts as JSON")
    add_folder(parser)


def add_folder(parser: argparse._ActionsContainer) -> None:
    """Add the option for the folder of the store.

    Args:
        parser: Parser to add to.
    """
    parser.add_argument(
        "--store", metavar="DIR", help="folder of the store (default: LIGHTWELL_STORE, else the platform's for caches)"
    )


def run(arguments: argparse.Namespace) -> int:
    """Print the contents of the store, or clear it.

    Args:
        arguments: Parsed arguments.

    Returns:
        Exit code.
    """
    from lightwell.core.store import user_store

    store = user_store(arguments.store)
    if arguments.action == "clear":
        removed = store.clear()
        facts: dict[str, Any] = {"folder": str(store.folder), "removed_bytes": removed}
        print(json.dumps(facts, indent=1) if arguments.json else f"{store.folder}: {size_text(removed)} removed")
        return 0
    held: dict[str, list[int]] = defaultdict(list)
    for entry in store.entries():
        held[entry.function].append(entry.bytes)
    total, limit = sum(map(sum, held.values())), store.limit
    if arguments.json:
        functions = {name: {"entries": len(sizes), "bytes": sum(sizes)} for name, sizes in sorted(held.items())}
        facts = {"folder": str(store.folder), "bytes": total, "limit_bytes": limit, "functions": functions}
        print(json.dumps(facts, indent=1))
        return 0
    print(f"{store.folder}: {size_text(total)}" + (f" of {size_text(limit)}" if limit is not None else ""))
    for name, sizes in sorted(held.items()):
        print(f"  {name:<28}{len(sizes):>8} entries{size_text(sum(sizes)):>12}")
    return 0
