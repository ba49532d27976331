"""The verb ``doctor``."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence

from lightwell.cli.arguments import add_json


def add(parser: argparse.ArgumentParser, argv: Sequence[str]) -> None:
    """Add the arguments.

    Args:
        parser: Parser of the verb.
        argv: Words after the verb.
    """
    add_json(parser, "print the facts as JSON")


def run(arguments: argparse.Namespace) -> int:
    """Print facts about the installation, with cures for problems.

    Args:
        arguments: Parsed arguments.

    Returns:
        Exit code: 0, or 1 where there is a problem.
    """
    from lightwell import doctor

    report = doctor.report()
    if arguments.json:
        print(json.dumps(report, indent=1))
    else:
        print(report["machine"])
        for check in report["checks"]:
            cure = f"\n{'':14}{check['cure']}" if check["cure"] and (not check["ok"] or check["name"] == "gpu") else ""
            print(f"{'ok  ' if check['ok'] else 'FAIL'} {check['name']:<9}{check['found']}{cure}")
    return 0 if all(check["ok"] for check in report["checks"]) else 1
