"""Files of three.js, Babylon.js, PlayCanvas and Bevy."""

import json
import re
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tree_sitter_rust
from tree_sitter import Language, Parser

from lightwell.engines import ENGINES
from lightwell.engines.bake import read_bake
from lightwell.engines.ktx2 import encode_rgba16f
from lightwell.engines.probe_grid import read_grid
from lightwell.probes import sh

ROOT = Path(__file__).parents[2]
WEB = ROOT / "web"


def node(program: str, *arguments: str) -> str:
    """What a module prints that runs beside the web's packages."""
    command = ["node", "--input-type=module", "-e", program, *arguments]
    done = subprocess.run(command, cwd=WEB, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("engine", ["threejs", "babylon", "playcanvas"])
def test_the_module_is_javascript_and_the_light_map_has_its_size(exported, engine):
    path = exported(engine) / "lightwell.js"
    copy = path.with_suffix(".mjs")
    copy.write_text(path.read_text())
    subprocess.run(["node", "--check", str(copy)], check=True, capture_output=True)
    assert 'new Set(["floor", "wall"])' in path.read_text()
    assert (exported(engine) / "light_map.bin").stat().st_size == 16 * 16 * 4 * 2


# Loads the exported module beside the web's packages; its files are read from the disk.
MODULE = """
import { readFileSync } from "node:fs";
const folder = process.argv[1];
globalThis.fetch = async (url) => ({ ok: true, arrayBuffer: async () => new Uint8Array(readFileSync(url)).buffer });
const text = readFileSync(folder + "lightwell.js", "utf8");
const resolved = text.replace(/from "([^"]+)"/g, (_, name) => `from ${JSON.stringify(import.meta.resolve(name))}`);
const made = await import("data:text/javascript;base64," + Buffer.from(resolved).toString("base64"));
"""
THREE = """
const { Group, Mesh, MeshStandardMaterial } = await import("three");
const { LightProbeGridWebGL } = await import("three/addons/lighting/LightProbeGridWebGL.js");
const root = new Group();
for (const name of ["floor", "sky"]) root.add(Object.assign(new Mesh(undefined, new MeshStandardMaterial()), { name }));
const map = await made.applyLightMap(root, folder);
const grid = await made.probeGrid(LightProbeGridWebGL, folder);
const { width, height, depth } = grid.texture.image;
const place = grid.getProbePosition(1, 0, 1, grid.position.clone());
console.log(JSON.stringify({
  maps: root.children.map(({ material }) => [material.lightMap === map, material.lightMapIntensity]),
  sizes: [map.image.width, map.image.height, map.channel, width, height, depth, grid.texture.image.data.length],
  place: place.toArray(),
}));
"""
BABYLON = """
const { NullEngine } = await import("@babylonjs/core/Engines/nullEngine.js");
const { Scene } = await import("@babylonjs/core/scene.js");
const { Mesh } = await import("@babylonjs/core/Meshes/mesh.js");
const { PBRMaterial } = await import("@babylonjs/core/Materials/PBR/pbrMaterial.js");
const { pbrPixelShader } = await import("@babylonjs/core/Shaders/pbr.fragment.js");
const { ShaderStore } = await import("@babylonjs/core/Engines/shaderStore.js");
const scene = new Scene(new NullEngine());
for (const name of ["floor", "sky"]) new Mesh(name, scene).material = new PBRMaterial(name, scene);
const map = await made.applyLightMap(scene, folder);
const plugins = scene.meshes.map((mesh) => mesh.material.pluginManager?.getPlugin("LightwellLightMap") ?? null);
const shader = pbrPixelShader.shader + Object.values(ShaderStore.IncludesShadersStore).join("");
const points = Object.keys(plugins[0].getCustomCode("fragment"));
const used = [...points.map((point) => `#define ${point}`), "finalDiffuse", "surfaceAlbedo", "vMainUV2"];
console.log(JSON.stringify({
  lit: plugins.map((plugin) => plugin !== null),
  size: [map.getSize().width, map.getSize().height],
  missing: used.filter((name) => !shader.includes(name)),
}));
"""
PLAYCANVAS = """
const { NullGraphicsDevice, PIXELFORMAT_RGBA16F, StandardMaterial } = await import("playcanvas");
const size = { width: 1, height: 1 };
const canvas = { ...size, clientWidth: 1, clientHeight: 1, addEventListener() {}, getBoundingClientRect: () => size };
const graphicsDevice = new NullGraphicsDevice(canvas);
const meshInstances = () => [{ material: new StandardMaterial() }];
const renders = ["floor", "sky"].map((name) => ({ entity: { name }, meshInstances: meshInstances() }));
const map = await made.applyLightMap({ graphicsDevice }, { findComponents: () => renders }, folder);
const materials = renders.map(({ meshInstances: [instance] }) => instance.material);
console.log(JSON.stringify({
  lit: materials.map((material) => material.lightMap === map && material.lightMapUv === 1),
  size: [map.width, map.height],
  missing: map.format === PIXELFORMAT_RGBA16F ? [] : ["half floats"],
}));
"""


@pytest.mark.parametrize(("engine", "program"), [("babylon", BABYLON), ("playcanvas", PLAYCANVAS)])
def test_the_library_takes_the_light_map_on_the_lit_meshes(exported, engine, program):
    found = json.loads(node(MODULE + program, str(exported(engine)) + "/").splitlines()[-1])
    assert found == {"lit": [True, False], "size": [16, 16], "missing": []}


def test_three_takes_the_light_map_and_the_grid_of_probes(exported, bake_folder):
    found = json.loads(node(MODULE + THREE, str(exported("threejs")) + "/"))
    assert found["maps"] == [[True, pytest.approx(np.pi)], [False, 1]]
    lattice = read_grid([bake_folder / "probes-static.lwp"]).lattice
    nx, ny, nz = lattice.shape
    assert found["sizes"] == [16, 16, 1, nx, ny, 7 * (nz + 2), nx * ny * 7 * (nz + 2) * 4]
    np.testing.assert_allclose(found["place"], lattice.origin + lattice.spacing * np.array([1, 0, 1]), atol=1e-5)


def test_threes_sum_of_the_packed_harmonics_is_the_irradiance(exported, bake_folder):
    grid = read_grid([bake_folder / "probes-static.lwp"])
    nx, ny, nz = grid.lattice.shape
    atlas = np.fromfile(exported("threejs") / "probes.bin", "<f2").astype(float).reshape(7, nz + 2, ny, nx, 4)
    np.testing.assert_array_equal(atlas[:, 0], atlas[:, 1])
    np.testing.assert_array_equal(atlas[:, -1], atlas[:, -2])
    packed = atlas[:, 1:-1].transpose(1, 2, 3, 0, 4).reshape(-1, 28)[:, :27].reshape(-1, 9, 3)
    normals = sh.directions(5)
    x, y, z = normals.T
    # getLightProbeGridIrradiance of three.js (ShaderChunk/lightprobes_pars_fragment).
    a, b = 2 * 0.511664, 2 * 0.429043
    terms = [0.886227 + 0 * x, a * y, a * z, a * x, b * x * y, b * y * z, 0.743125 * z * z - 0.247708, b * x * z]
    terms += [0.429043 * (x * x - y * y)]
    found = np.einsum("kn,pkc->pnc", np.array(terms), packed)
    expected = np.stack([sh.evaluate(e, normals) for e in grid.irradiance])
    np.testing.assert_allclose(found, expected, atol=2e-3 * np.abs(expected).max())


KTX = """
import { readFileSync } from "node:fs";
import { read } from "ktx-parse";
const { vkFormat, typeSize, pixelWidth, pixelHeight, pixelDepth, layerCount, faceCount, levels, dataFormatDescriptor } =
  read(new Uint8Array(readFileSync(process.argv[1])));
const [{ colorModel, transferFunction, samples }] = dataFormatDescriptor;
console.log(JSON.stringify({ vkFormat, typeSize, size: [pixelWidth, pixelHeight, pixelDepth], layerCount, faceCount,
  colorModel, transferFunction, samples: samples.map((s) => [s.bitOffset, s.bitLength, s.channelType]),
  data: Buffer.from(levels[0].levelData).toString("base64") }));
"""


def test_bevys_volume_has_the_sides_where_bevy_reads_them(exported, bake_folder):
    import base64

    grid = read_grid([bake_folder / "probes-static.lwp"])
    nx, ny, nz = grid.lattice.shape
    found = json.loads(node(KTX, str(exported("bevy") / "irradiance.ktx2")))
    assert (found["vkFormat"], found["typeSize"], found["size"]) == (97, 2, [nx, 2 * ny, 3 * nz])
    assert (found["layerCount"], found["faceCount"], found["colorModel"], found["transferFunction"]) == (0, 1, 1, 1)
    assert found["samples"] == [[16 * i, 15, c | 0xC0] for i, c in enumerate((0, 1, 2, 15))]
    voxels = np.frombuffer(base64.b64decode(found["data"]), "<f2").astype(float).reshape(3 * nz, 2 * ny, nx, 4)
    probe = 1 + nx * (0 + ny * 1)
    for axis in range(3):
        for sign in (-1, 1):
            side = sign * np.eye(3)[axis]
            expected = np.maximum(sh.evaluate(grid.irradiance[probe], side[None])[0], 0) / np.pi
            # neg_offset of irradiance_volume_light: normals against the axis read half the height further.
            texel = voxels[1 + axis * nz, ny if sign < 0 else 0, 1, :3]
            np.testing.assert_allclose(texel, expected, rtol=2e-3, atol=1e-4)


def test_bevys_light_map_is_a_picture_and_its_module_is_rust(exported, bake_folder):
    assert json.loads(node(KTX, str(exported("bevy") / "light_map.ktx2")))["size"] == [16, 16, 0]
    rust = Parser(Language(tree_sitter_rust.language()))
    text = (exported("bevy") / "lightwell.rs").read_text()
    assert not rust.parse(text.encode()).root_node.has_error
    assert rust.parse(text.replace("};", "}", 1).encode()).root_node.has_error
    assert 'const LIT: [&str; 2] = ["floor", "wall"];' in text
    assert read_bake(bake_folder).probes is not None


def test_bevys_module_has_floats_where_a_grid_has_whole_numbers(bake_folder):
    bake = read_bake(bake_folder)
    lattice = replace(bake.probes.lattice, origin=np.array([-1.0, 0, 0.5]), spacing=2.0)
    made = ENGINES["bevy"](replace(bake, probes=replace(bake.probes, lattice=lattice)), None)["lightwell.rs"]
    [arguments] = re.findall(r"Transform::from_xyz\((.*)\)\.with_scale\(Vec3::new\((.*)\)\),", made.decode())
    words = ", ".join(arguments).split(", ")
    assert len(words) == 6 and all(re.fullmatch(r"-?\d+(\.\d+)?(e[-+]\d+)?", word) for word in words)
    assert all("." in word or "e" in word for word in words)
    assert arguments[1].split(", ") == [f"{2 * n}.0" for n in lattice.shape]


@pytest.mark.parametrize("engine", sorted(set(ENGINES) - {"unreal"}))
def test_names_of_lit_nodes_keep_their_letters(bake_folder, engine):
    names = ("Würfel", "壁", 'a "b" \\ c')
    made = ENGINES[engine](replace(read_bake(bake_folder), lit=names), None)
    text = "\n".join(data.decode() for name, data in made.items() if name.endswith((".js", ".rs", ".cs", ".tres")))
    assert "Würfel" in text and "壁" in text
    if engine != "godot":
        assert '"Würfel", "壁", "a \\"b\\" \\\\ c"' in text


def test_light_beyond_half_floats_is_refused():
    with pytest.raises(ValueError, match="range of half floats"):
        encode_rgba16f(np.full((1, 1, 4), 1e6))
