"""The verbs of the radiance cache: ``render --integrator nrc`` and ``live``."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

from lightwell import limit_arguments
from lightwell.cache.live_server import live
from lightwell.cache.rendering import render_animation, render_nrc
from lightwell.cache.settings import parse_options

# Exit code after Ctrl-C, as shells expect.
INTERRUPTED = 130


def run_render(arguments, size: tuple[int, int]) -> int:
    """A picture, or with ``--frames`` a sequence, of ``size`` pixels."""
    settings = parse_options(arguments.nrc)
    common = (settings, *size, arguments.spp)
    options = limit_arguments.scene_options(arguments)
    if arguments.frames is not None:
        if arguments.frames < 1:
            raise ValueError(f"render: --frames {arguments.frames}, expected at least 1")
        facts = render_animation(
            arguments.scene, Path(arguments.out), *common, arguments.frames, seed=arguments.seed,
            kind=arguments.format, resume=arguments.resume, quiet=arguments.json, force=arguments.force,
            **options,
        )  # fmt: skip
    else:
        facts = render_nrc(arguments.scene, Path(arguments.out), *common, seed=arguments.seed, **options)
    text = f"{arguments.out}: {size[0]}x{size[1]}, {facts['seconds']:.1f} s"
    print(json.dumps(facts, indent=1) if arguments.json else text)
    return 0


def run_live(arguments) -> int:
    """Serve the page until interrupted."""
    if not 16 <= arguments.size <= 2048:
        raise ValueError(f"live: --size {arguments.size}, expected 16 ... 2048 pixels")
    options = limit_arguments.scene_options(arguments)
    settings, page = parse_options(arguments.nrc), (arguments.size, arguments.port, not arguments.no_open)
    try:
        live(arguments.scene, settings, *page, **options)
    except KeyboardInterrupt:
        # Kernels may be running or be compiled in other threads; Python's orderly end would crash in them.
        sys.stdout.flush()
        os._exit(INTERRUPTED)
    return 0
