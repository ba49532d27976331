"""Every test vector in HLSL, WGSL, Metal's and Godot's language. GLSL and WGSL in Chromium: web/test."""

import functools
import json
import re
from pathlib import Path

import lark
import numpy as np
import pytest
from clang import cindex
from hlsl_runner import VECTORS, Runner, compiled, compiled_glsl, in_blocks, programs, rows, shader

HERE = Path(__file__).parent
# The contract: evaluators agree to this, relative to max(1, |value|).
TOLERANCE = 1e-4
VECTOR_COUNT = len(list(VECTORS.glob("*.json")))

printed = functools.cache(programs)


@functools.cache
def runner() -> Runner:
    return Runner()


def worst(found: np.ndarray, expected: np.ndarray) -> float:
    return float((np.abs(found - expected) / np.maximum(1, np.abs(expected))).max())


def run_hlsl(program: dict, folder: Path) -> float:
    """Largest error of a printed program against its vector."""
    vector = json.loads((VECTORS / f"{program['name']}.json").read_text())
    points = max(tensor["shape"][0] for tensor in vector["inputs"].values())
    inputs = [in_blocks(rows(vector["inputs"][p["name"]], points)) for p in program["parameters"]]
    outputs = [in_blocks(rows(vector["outputs"][o["name"]], points)) for o in program["outputs"]]
    spirv = compiled(shader(program), folder)
    found = runner().run(spirv, program, np.concatenate(inputs, axis=1), points)
    return worst(found, np.concatenate(outputs, axis=1))


def test_every_vector_is_printed_with_weights_in_the_text_and_in_a_texture():
    assert len(printed("hlsl")) == 2 * VECTOR_COUNT > 200


def some(language: str, weights: str, step: int) -> dict[str, dict]:
    """Every ``step``-th vector's program by name: compilers are processes of their own, one for each program."""
    names = [name for name, placed in printed(language) if placed == weights]
    return {name: printed(language)[name, weights] for name in names[::step]}


EVERY = pytest.mark.parametrize("step", [4, pytest.param(1, marks=pytest.mark.slow)], ids=["some", "every"])


@EVERY
@pytest.mark.parametrize("weights", ["inline", "table"])
def test_hlsl_of_vectors_compiles_with_glslang(weights, step, tmp_path):
    for name, program in some("hlsl", weights, step).items():
        assert compiled(shader(program), tmp_path)[:4] == b"\x03\x02\x23\x07", name


def test_glslang_refuses_what_is_no_hlsl(tmp_path):
    program = dict(printed("hlsl")["network_report", "inline"])
    program["code"] = program["code"].replace("mul(", "mix(", 1)
    with pytest.raises(RuntimeError, match="mix"):
        compiled(shader(program), tmp_path)


@pytest.mark.parametrize("name", ["network_report", "network_segments", "hashgrid_4x2_8", "tree_6_12", "top2_9"])
def test_hlsl_equals_numpy(name, tmp_path):
    for weights in ("inline", "table"):
        assert run_hlsl(printed("hlsl")[name, weights], tmp_path) < TOLERANCE, weights


@pytest.mark.slow
@pytest.mark.parametrize("weights", ["inline", "table"])
def test_hlsl_of_every_vector_equals_numpy(weights, tmp_path):
    for (name, placed), program in printed("hlsl").items():
        if placed == weights:
            assert run_hlsl(program, tmp_path) < TOLERANCE, name


def test_a_wrong_weight_is_seen(tmp_path):
    program = dict(printed("hlsl")["linear_3_4", "inline"])
    program["code"] = re.sub(
        r"mul\((\w+), float4x4\(float4\(\S+,", r"mul(\1, float4x4(float4(9.0,", program["code"], count=1
    )
    assert run_hlsl(program, tmp_path) > TOLERANCE


def test_wgsl_of_every_vector_passes_naga():
    device = runner().device
    for (name, weights), program in printed("wgsl").items():
        module = device.create_shader_module(code=program["code"])
        assert module is not None, (name, weights)
    with pytest.raises(Exception, match="mixx"):
        device.create_shader_module(code="fn field(a: f32) -> f32 { return mixx(a, a, a); }")


def metal_errors(code: str) -> list[str]:
    """What clang finds wrong with a text in Metal shading language."""
    text = (HERE / "metal_subset.h").read_text() + code
    arguments = ["-x", "c++", "-std=c++14"]
    unit = cindex.Index.create().parse("field.cpp", args=arguments, unsaved_files=[("field.cpp", text)])
    return [str(found) for found in unit.diagnostics if found.severity >= cindex.Diagnostic.Warning]


def test_metal_of_every_vector_passes_clang():
    """Syntax and types against declarations of the specification; Apple's compiler has never seen these texts."""
    code, seen = [], set()
    # One translation unit: the functions of a program get names of their own.
    for i, program in enumerate(printed("msl").values()):
        seen.add(program["name"])
        code.append(re.sub(r"\bfield(?=\b|_)", f"f{i}", program["code"]))
    assert metal_errors("\n".join(code)) == []
    assert len(seen) == VECTOR_COUNT


@pytest.mark.parametrize(
    ("old", "new"), [("float2 g", "float3 g"), ("mix(", "lerp("), (";", ""), ("floor(", "floor(1.0, ")]
)
def test_clang_refuses_what_is_no_metal(old, new):
    code = printed("msl")["frequency_3_5", "inline"]["code"]
    assert old in code and metal_errors(code.replace(old, new, 1))


@functools.cache
def godot() -> lark.Lark:
    return lark.Lark((HERE / "gdshader.lark").read_text(), parser="lalr")


def godot_errors(code: str) -> list[str]:
    """What breaks the grammar, or Godot's rules that a grammar cannot hold."""
    try:
        tree = godot().parse(code)
    except lark.exceptions.LarkError as error:
        return [str(error)]
    wrong = []
    for shift in tree.find_data("shift"):
        if shift.children[2].data == "number" and shift.children[2].children[0].type == "UINT":
            wrong.append("a shift of an int by a uint")
    for function in tree.find_data("function"):
        parts = [part for part in function.children if isinstance(part, lark.Tree)]
        names = {str(part.children[1]) for part in parts if part.data == "parameter"}
        wrong += shadowed(parts[-1], names)
    return wrong


def shadowed(block: lark.Tree, outer: set[str]) -> list[str]:
    """Names that a block declares again: Godot refuses it in nested blocks too."""
    names, wrong = set(outer), []
    for statement in block.children:
        if statement.data in ("declaration", "array_declaration"):
            name = str(statement.children[1])
            wrong += [f"'{name}' twice"] if name in names else []
            names.add(name)
        elif statement.data == "loop":
            wrong += shadowed(statement.children[-1], names | {str(statement.children[0])})
        elif statement.data == "block":
            wrong += shadowed(statement, names)
    return wrong


def test_godots_language_of_every_vector_keeps_to_its_grammar():
    """Grammar alone; Godot has never compiled these texts."""
    for (name, weights), program in printed("gdshader").items():
        assert godot_errors(program["code"]) == [], (name, weights)


def as_glsl(code: str) -> str:
    """Godot's language as GLSL ES 3.10, whose types are as strict: hints and lists are written otherwise."""
    count = iter(range(9))
    code = re.sub(
        r"uniform sampler2D (\w+) : [^;]*;",
        lambda m: f"layout(binding = {next(count)}) uniform sampler2D {m[1]};",
        code,
    )
    code = re.sub(r"(\w+) (\w+)\[(\d+)\] = \{ (.*) \};", r"\1 \2[\3] = \1[\3](\4);", code)
    return f"#version 310 es\nprecision highp float;\nprecision highp int;\n{code}\nvoid main() {{}}\n"


@EVERY
def test_godots_language_of_vectors_has_the_types_of_glsl(step, tmp_path):
    for program in some("gdshader", "table", step).values():
        compiled_glsl(as_glsl(program["code"]), tmp_path)
    with pytest.raises(RuntimeError, match="cannot convert"):
        compiled_glsl(as_glsl("float f(int x) { float y = x; return y; }"), tmp_path)


@pytest.mark.parametrize(
    ("code", "word"),
    [
        ("float f(float x) { return x }", "Unexpected"),
        ("float f(int x) { return float(x >> 1u); }", "a shift of an int by a uint"),
        ("float f(float x) { float y = x; { float y = x; } return y; }", "'y' twice"),
        ("float f(float x) { float[2] y = float[2](x, x); return y[0]; }", "Unexpected"),
        ("uniform highp sampler2D t;", "No terminal"),
    ],
)
def test_the_grammar_refuses_mistakes(code, word):
    assert word in "".join(godot_errors(code))
