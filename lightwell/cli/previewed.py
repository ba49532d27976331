"""A bake with a page that shows what is learned while it is learned."""

from __future__ import annotations

import argparse
import sys
import webbrowser

from lightwell.baking.settings import BakeSettings


def bake_with_page(arguments: argparse.Namespace, asked: BakeSettings) -> int:
    """Bake while a page on this machine shows the light; at a terminal the page stays until Ctrl-C.

    Args:
        arguments: Parsed arguments.
        asked: Settings of the bake.

    Returns:
        Exit code.
    """
    from lightwell.baking.preview import Preview
    from lightwell.cli.run_bake import run_bake
    from lightwell.serving.server import LocalServer, wait_for_interrupt

    def opened() -> None:
        print(f"{url}  (the light while it is learned)", file=sys.stderr, flush=True)
        if not arguments.no_open:
            webbrowser.open(url)

    preview = Preview(opened)
    with LocalServer(preview.application(), arguments.port, arguments.verb) as server:
        url = f"{server.url}?page=page.json"
        code = run_bake(arguments, asked, preview)
        if sys.stdout.isatty():
            print(f"{server.url}result/index.html  (Ctrl-C ends)", flush=True)
            wait_for_interrupt()
    return code
