"""What engines can take of a bake: printers of the shading graph, exports, scenes, Blender.

    python benchmarks/engines.py            # writes results/engines.json; needs Node, glslang and a Vulkan driver
    python benchmarks/engines.py --quick    # a few vectors, writes nothing
    LIGHTWELL_BPY=/path/to/python …         # rows of the Blender extension: a Python with bpy

Rows that need a package or program which is missing are null, with the reason.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
sys.path.insert(0, str(ROOT / "tests/graph"))

from benchmarks.rows import Row, at_least, at_most, publish  # noqa: E402

# Vectors of a smoke run.
QUICK = 4


def share(printed: dict, good: Callable[[dict], bool]) -> float:
    """Percent of the programs that a check accepts."""
    return 100 * sum(map(good, printed.values())) / len(printed)


def programs(language: str, quick: bool) -> dict:
    """Every vector printed in a language; a few of them in a smoke run."""
    from hlsl_runner import programs as printed

    found = printed(language)
    return dict(list(found.items())[:QUICK]) if quick else found


def hlsl_rows(quick: bool) -> list[Row]:
    """HLSL by glslang, its values through wgpu."""
    from hlsl_runner import Runner, compiled, shader

    printed = programs("hlsl", quick)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)

        def compiles(program: dict) -> bool:
            try:
                return bool(compiled(shader(program), folder))
            except RuntimeError:
                return False

        rows = [at_least("HLSL: vectors that glslang compiles", 100, share(printed, compiles), "%")]
        from test_languages import run_hlsl

        worst = max(run_hlsl(program, folder) for program in printed.values())
    rows.append(
        at_most("HLSL: largest relative error against NumPy", 1e-4, worst, "", "SPIR-V of glslang through wgpu")
    )
    return [*rows, wgsl_row(Runner(), quick)]


def wgsl_row(runner, quick: bool) -> Row:
    """WGSL by naga."""

    def passes(program: dict) -> bool:
        try:
            runner.device.create_shader_module(code=program["code"])
        except Exception:
            return False
        return True

    return at_least("WGSL: vectors that pass naga", 100, share(programs("wgsl", quick), passes), "%", "by wgpu")


def checked_rows(quick: bool) -> list[Row]:
    """Metal by clang, Godot's language by its grammar."""
    from test_languages import godot_errors, metal_errors

    metal, godot = programs("msl", quick), programs("gdshader", quick)
    return [
        at_least(
            "MSL: vectors that pass clang",
            100,
            share(metal, lambda p: not metal_errors(p["code"])),
            "%",
            "never compiled",
        ),
        at_least(
            "Godot: vectors in its grammar",
            100,
            share(godot, lambda p: not godot_errors(p["code"])),
            "%",
            "never compiled",
        ),
    ]


def blender_rows() -> list[Row]:
    """The modal operator in bpy."""
    steps, cancel = "Blender: longest modal step", "Blender: from Esc to the end of the process"
    python = os.environ.get("LIGHTWELL_BPY")
    if not python:
        note = "needs LIGHTWELL_BPY, a Python that has bpy"
        return [at_most(steps, 50, None, "ms", note), at_most(cancel, 1, None, "s", note)]
    script = ROOT / "tests/integrations/in_blender.py"
    with tempfile.TemporaryDirectory() as folder:
        command = [python, str(script), str(ROOT / "integrations/blender"), folder]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    found = re.search(r"longest step ([\d.]+) ms, cancel ([\d.]+) s", done.stdout)
    assert found, done.stdout
    return [at_most(steps, 50, float(found[1]), "ms"), at_most(cancel, 1, float(found[2]), "s")]


def open_rows() -> list[Row]:
    """What is asked and not measured by this command yet."""
    return [
        at_least("PlayCanvas: diffuse light against the page", 40, None, "dB", "the exported module has never run"),
        at_least("Babylon.js: diffuse light against the page", 40, None, "dB", "the exported module has never run"),
        at_least("KTX2: GPU memory of pictures, times less", 4, None, "times", "not built"),
        at_most("KTX2: loss", 0.5, None, "dB", "not built"),
        at_most("courtyard through USD, OBJ and GLB: bake errors apart", 5, None, "%", "not measured"),
    ]


def main() -> None:
    """Measure, print and write the rows."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a few vectors; writes nothing")
    quick = parser.parse_args().quick
    rows = [*hlsl_rows(quick), *checked_rows(quick), *blender_rows(), *open_rows()]
    publish("engines", rows, quick)


if __name__ == "__main__":
    main()
