"""What engines can take of a bake: printers of the shading graph, exports, scenes, Blender.

    python benchmarks/engines.py            # writes results/engines.json; needs Node, glslang and a Vulkan driver
    python benchmarks/engines.py --quick    # a few vectors, writes nothing
    LIGHTWELL_BPY=/path/to/python …         # rows of the Blender extension: a Python with bpy

Rows that need a package or program which is missing are null, with the reason.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(ROOT / "tests/graph"))
sys.path.insert(0, str(ROOT / "tests/engines"))

from rows import Row, at_least, at_most, chosen, publish  # noqa: E402

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


def hlsl(quick: bool) -> list[Row]:
    """HLSL by glslang."""
    from hlsl_runner import compiled, shader

    with tempfile.TemporaryDirectory() as name:

        def compiles(program: dict) -> bool:
            try:
                return bool(compiled(shader(program), Path(name)))
            except RuntimeError:
                return False

        return [at_least("HLSL: vectors that glslang compiles", 100, share(programs("hlsl", quick), compiles), "%")]


def values(quick: bool) -> list[Row]:
    """Values of HLSL: SPIR-V of glslang through wgpu."""
    from test_languages import run_hlsl

    with tempfile.TemporaryDirectory() as name:
        worst = max(run_hlsl(program, Path(name)) for program in programs("hlsl", quick).values())
    return [at_most("HLSL: largest relative error against NumPy", 1e-4, worst, "", "SPIR-V of glslang through wgpu")]


def wgsl(quick: bool) -> list[Row]:
    """WGSL by naga."""
    from hlsl_runner import Runner

    runner = Runner()

    def passes(program: dict) -> bool:
        try:
            runner.device.create_shader_module(code=program["code"])
        except Exception:
            return False
        return True

    return [at_least("WGSL: vectors that pass naga", 100, share(programs("wgsl", quick), passes), "%", "by wgpu")]


def metal(quick: bool) -> list[Row]:
    """Metal's language by clang."""
    from test_languages import metal_errors

    passing = share(programs("msl", quick), lambda program: not metal_errors(program["code"]))
    return [at_least("MSL: vectors that pass clang", 100, passing, "%", "never compiled by Apple's compiler")]


def godot(quick: bool) -> list[Row]:
    """Godot's language by its grammar."""
    from test_languages import godot_errors

    passing = share(programs("gdshader", quick), lambda program: not godot_errors(program["code"]))
    return [at_least("Godot: vectors that keep to its grammar", 100, passing, "%", "never compiled by Godot")]


def blender(quick: bool) -> list[Row]:
    """The modal operator in bpy, with timer events; the bake is a process that sleeps."""
    steps, cancel = "Blender: longest modal step", "Blender: from Esc to the end of the process"
    python = os.environ.get("LIGHTWELL_BPY")
    if not python:
        note = "needs LIGHTWELL_BPY, a Python that has bpy"
        return [at_most(steps, 50, None, "ms", note), at_most(cancel, 1, None, "s", note)]
    script = ROOT / "tests/integrations/in_blender.py"
    with tempfile.TemporaryDirectory() as folder:
        command = [python, str(script), str(ROOT / "integrations/blender"), folder]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    found = re.search(r"Blender ([\d.]+), longest step ([\d.]+) ms, cancel ([\d.]+) s", done.stdout)
    assert found, done.stdout
    note = f"bpy {found[1]}"
    return [at_most(steps, 50, float(found[2]), "ms", note), at_most(cancel, 1, float(found[3]), "s", note)]


def ktx2(quick: bool) -> list[Row]:
    """Light maps in pictures that stay compressed on the GPU."""
    from lightmap_ktx2 import rows

    return rows(quick)


def drawn(quick: bool) -> list[Row]:
    """Exported light maps, drawn in Chromium by the engines of the browser, beside lightwell's own runtime."""
    from exported_pictures import Frame, pictures, psnr, write_diffuse

    from lightwell.baking.pipeline import bake
    from lightwell.baking.settings import BakeSettings
    from lightwell.engines import export_engine
    from lightwell.scenes import load

    names = {"three.js": "threejs", "PlayCanvas": "playcanvas", "Babylon.js": "babylon"}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        out, plain = folder / "out", folder / "plain.glb"
        bake(BakeSettings(scene="cornell", out=out, field="lightmap", quality="draft", views=1))
        write_diffuse(out / "scene.glb", plain)
        for engine in names.values():
            export_engine(out, engine, folder / engine)
        camera = load("cornell").cameras[0]
        place, target = (tuple(map(float, at)) for at in (camera.position, camera.target))
        found = pictures(plain, {e: folder / e for e in names.values()}, Frame(place, target, fov=camera.fov_y), folder)
    note = "diffuse light of the Cornell box, draft; Chromium with SwiftShader"
    what = "{}: light map of the export against the page"
    return [at_least(what.format(k), 40, psnr(found[v], found["page"]), "dB", note) for k, v in names.items()]


def round_trips(quick: bool) -> list[Row]:
    """The courtyard from three kinds of files, baked alike: how far the errors of the reports are apart."""
    sys.path.insert(0, str(ROOT / "tests/scenes"))
    from scene_writers import write_obj, write_usd

    from lightwell.asset.container import pack, unpack
    from lightwell.scenes import load

    counts = ["--shards", "2", "--steps", "60"] if quick else ["--shards", "16", "--steps", "3000"]
    errors = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scene = load("courtyard")
        write_usd(scene, folder / "courtyard.usdc")
        write_obj(scene, folder / "courtyard.obj")
        vary = [f"--vary={text}" for text in scene.vary]

        def baked(source: str, *words: str) -> Path:
            out = folder / f"baked {len(list(folder.glob('baked*')))}"
            command = [sys.executable, "-m", "lightwell.cli", "bake", source, "-o", str(out), "--no-static", *vary]
            subprocess.run([*command, *words, "--views", "1"], check=True, stdout=subprocess.DEVNULL)
            return out

        # A bake writes its scene as GLB. OBJ has no cameras, where points and views are chosen by: no file has any.
        document, binary = unpack((baked("courtyard", "--shards", "2", "--steps", "60") / "scene.glb").read_bytes())
        for node in document["nodes"]:
            node.pop("camera", None)
        document.pop("cameras", None)
        (folder / "courtyard.glb").write_bytes(pack(document, binary))
        for suffix in ("glb", "usdc", "obj"):
            report = baked(str(folder / f"courtyard.{suffix}"), *counts) / "report.json"
            errors[suffix] = json.loads(report.read_text())["relative_error"]
    note = f"{' '.join(counts)}, no cameras; " + ", ".join(f"{kind} {100 * e:.2f}%" for kind, e in errors.items())
    apart = 100 * (max(errors.values()) / min(errors.values()) - 1)
    return [at_most("courtyard through USD, OBJ and GLB: bake errors apart", 5, apart, "%", note)]


def blender_bytes(quick: bool) -> list[Row]:
    """A bake of the extension, and the same command on the file that it has exported."""
    what = "Blender: GLB bytes equal to the command line's"
    python = os.environ.get("LIGHTWELL_BPY")
    if not python:
        return [at_least(what, 100, None, "%", "needs LIGHTWELL_BPY, a Python that has bpy")]
    script = ROOT / "tests/integrations/in_blender.py"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        program, words = folder / "lightwell.sh", folder / "words"
        # By time two bakes are never alike: the counts are fixed behind the words of the extension.
        fixed = "--shards 2 --steps 100 --seed 0"
        bakes = f'case " $* " in *" bake "*) printf "%s\\n" "$@" > "{words}"; set -- "$@" {fixed};; esac'
        program.write_text(f'#!/bin/sh\n{bakes}\nexec "{sys.executable}" "$@"\n')
        program.chmod(0o755)
        baked = ROOT / "web/test/fixtures/lightmap.glb"
        added = {"LIGHTWELL_PYTHON": str(program), "LIGHTWELL_BAKED": str(baked), "LIGHTWELL_BAKE": "1"}
        command = [python, str(script), str(ROOT / "integrations/blender"), str(folder)]
        subprocess.run(command, env=os.environ | added, check=True, stdout=subprocess.DEVNULL)
        again = words.read_text().splitlines()
        at = again.index("-o") + 1
        first, again[at] = Path(again[at]), str(folder / "again")
        subprocess.run([sys.executable, *again, *fixed.split()], check=True, stdout=subprocess.DEVNULL)
        same = (first / "scene.glb").read_bytes() == (folder / "again/scene.glb").read_bytes()
    return [at_least(what, 100, 100 * same, "%", f"a light map, {fixed}")]


PARTS = {
    part.__name__: part for part in (hlsl, values, wgsl, metal, godot, blender, blender_bytes, ktx2, drawn, round_trips)
}


def main() -> None:
    """Measure, print and write the rows."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a few vectors; writes nothing")
    parser.add_argument("--only", help=f"comma-separated: {', '.join(PARTS)}")
    given = parser.parse_args()
    for name in chosen("--only", given.only, PARTS):
        publish("engines", PARTS[name](given.quick), given.quick)


if __name__ == "__main__":
    main()
