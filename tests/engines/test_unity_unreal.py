"""Files of Unity and Unreal: C# by tree-sitter, harmonics by Unity's formula, the Custom node by glslang. Never run."""

import subprocess
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import tree_sitter_c_sharp
from tree_sitter import Language, Parser

from lightwell.asset.export import Exported
from lightwell.cli import main
from lightwell.engines import unity
from lightwell.engines.bake import read_bake
from lightwell.engines.probe_grid import read_grid
from lightwell.engines.shaders import MAX_FUNCTION, function_names, table_picture
from lightwell.exr.chunks import read_header
from lightwell.exr.decoding import decode_parts
from lightwell.graph.pictures import decoded
from lightwell.limits import Limits
from lightwell.probes import sh

ROOT = Path(__file__).parents[2]
C_SHARP = Parser(Language(tree_sitter_c_sharp.language()))


def broken(text: str) -> bool:
    return C_SHARP.parse(text.encode()).root_node.has_error


def test_the_scripts_are_c_sharp(exported):
    scripts = sorted(exported("unity").rglob("*.cs"))
    assert [path.name for path in scripts] == ["LightwellImport.cs", "LightwellLight.cs"]
    for path in scripts:
        assert not broken(path.read_text()), path
    assert 'Lit = { "floor", "wall" }' in scripts[0].read_text()
    assert broken(scripts[1].read_text().replace("};", "}"))
    assert broken("class A { void f() { int x = ; } }")


def test_unitys_sum_of_the_harmonics_is_irradiance_over_pi_with_x_mirrored(exported, bake_folder):
    grid = read_grid([bake_folder / "probes-static.lwp"])
    rows = np.loadtxt(exported("unity") / "probe_light.txt")
    light = rows[:, 3:].reshape(-1, 9, 3)
    normals = sh.directions(5)
    x, y, z = (normals * [-1, 1, 1]).T
    # SphericalHarmonicsL2.Evaluate: coefficients times the real harmonics without signs (Sloan, "Stupid SH tricks").
    harmonics = [0.282095 + 0 * x, 0.488603 * y, 0.488603 * z, 0.488603 * x, 1.092548 * x * y, 1.092548 * y * z]
    harmonics += [0.315392 * (3 * z * z - 1), 1.092548 * x * z, 0.546274 * (x * x - y * y)]
    found = np.einsum("kn,pkc->pnc", np.array(harmonics), light)
    expected = np.stack([sh.evaluate(e, normals) for e in grid.irradiance]) / np.pi
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.abs(expected).max())
    np.testing.assert_allclose(rows[:, 0], -grid.lattice.nodes()[:, 0], atol=1e-5)


@pytest.mark.parametrize("bottom_up", [False, True])
def test_a_table_begins_where_the_engine_reads_row_0(tmp_path, bottom_up):
    rows = np.arange(24, dtype="<f4").reshape(3, 2, 4)
    made = Exported("", {"t": rows.tobytes()}, {}, {"t": (2, 3, "rgba32float")})
    path = tmp_path / "t.exr"
    path.write_bytes(table_picture(made, "t", bottom_up))
    [part] = decode_parts(path, read_header(path, Limits().budget("table")), [0], 60)
    found = np.stack([part.flat[c] for c in "RGBA"], axis=2)
    np.testing.assert_array_equal(found[::-1] if bottom_up else found, rows)


def test_unitys_pictures_of_shaders_begin_with_the_lowest_row(exported):
    name = "lightwell_lightmap_picture0.png"
    unity, unreal = (decoded((exported(engine) / name).read_bytes()) for engine in ("unity", "unreal"))
    np.testing.assert_array_equal(unity, unreal[::-1])
    assert not np.array_equal(unity, unreal)


def test_unity_keeps_the_numbers_of_shader_textures(exported, bake_folder):
    script = (exported("unity") / "Editor/LightwellImport.cs").read_text()
    kept = ["npotScale = TextureImporterNPOTScale.None", "filterMode = isTable ? FilterMode.Point"]
    kept += ["textureCompression = TextureImporterCompression.Uncompressed", "mipmapEnabled = !isTable"]
    kept += ["sRGBTexture = false"]
    assert [line for line in kept if f"importer.{line}" not in script] == []
    # Fields without light map and probes have textures too.
    made = unity.files(replace(read_bake(bake_folder), light_map=None, probes=None), None)
    assert "Editor/LightwellImport.cs" in made and "LightwellLight.cs" in made


def test_the_code_of_the_custom_node_compiles_with_its_include_file(exported, tmp_path):
    note = (exported("unreal") / "lightwell_lightmap.custom-node.txt").read_text()
    code = note.split("Code:\n")[1].splitlines()[0]
    lines = dict(line.split(":", 1) for line in note.splitlines() if ":" in line and not line.startswith("Code"))
    textures = [name.strip() for name in lines["Textures"].split(",")]
    bound = [
        f"Texture2D<float4> {t} : register(t{i}); SamplerState {t}Sampler : register(s{i});"
        for i, t in enumerate(textures)
    ]
    widths = {"TexCoord0": 2, "TexCoord1": 2, "Roughness": 1, "Metallic": 1}
    inputs = [name.strip() for name in lines["Inputs"].split(",")]
    given = [f"float{widths.get(name, 3)} {name}" if widths.get(name, 3) > 1 else f"float {name}" for name in inputs]
    arguments = ", ".join(f"data.{'xyz'[: widths.get(name, 3)]}" for name in inputs)
    source = [
        (exported("unreal") / "lightwell_lightmap.ush").read_text(),
        *bound,
        f"float3 Custom0({', '.join(given)}) {{ {code} }}",
        f"float4 main(float4 data : TEXCOORD0) : SV_Target {{ return float4(Custom0({arguments}), 1.0); }}",
    ]
    path = tmp_path / "node.hlsl"
    path.write_text("\n".join(source))
    glslang = subprocess.run(
        [ROOT / "tools/find-glslang.sh"], capture_output=True, text=True, check=True
    ).stdout.strip()
    command = [glslang, "-V", "-D", "-S", "frag", "-e", "main", "-o", str(tmp_path / "node.spv"), str(path)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_a_field_with_dimmers_is_refused_for_unreal_in_one_line(tmp_path, capsys):
    asset = ROOT / "web/test/fixtures/lightmap-lamps.glb"
    assert main(["export", str(asset), "--to", "unreal", "-o", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert "reads lamps, which a Custom node of Unreal has not; take it with --to hlsl" in error
    assert error.count("\n") == 1 and not (tmp_path / "out").exists()


def test_fields_with_names_that_begin_alike_have_functions_of_their_own():
    fields = [SimpleNamespace(name=name) for name in ("light of the second floor a", "sun", "Sun", "sun!")]
    fields += [SimpleNamespace(name=f"light of the second floor {k}") for k in range(12)]
    names = function_names(fields)
    assert names["sun"] == "lightwell_sun" and names["Sun"] == "lightwell_Sun_2" and names["sun!"] == "lightwell_sun_3"
    assert len({name.lower() for name in names.values()}) == len(fields) == len(names)
    assert all(len(name) <= MAX_FUNCTION and name.isidentifier() for name in names.values())
