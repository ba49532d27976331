"""Tests take the public way: they replace no constants of modules and reach no private names of the package."""

import ast
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent
# Names with an underscore that belong to others: the protocol of notebooks, the end of a process without clean-up, and
# what argparse knows of a parser's options.
ALLOWED = {"_repr_html_", "_repr_png_", "_exit", "_actions", "_option_string_actions"}
PATCHES = ("setattr", "setitem", "delattr", "delitem")
# Dictionaries of the interpreter, which stand for what is installed and for the environment.
DICTIONARIES = {"sys.modules", "os.environ"}


def is_private(name: str) -> bool:
    return name.startswith("_") and not name.startswith("__") and name not in ALLOWED


def is_constant(name: str) -> bool:
    return name.isupper() and len(name) > 1


def patched(call: ast.Call) -> str | None:
    """What a call of ``monkeypatch`` must not replace, if it does."""
    function = call.func
    if not isinstance(function, ast.Attribute) or function.attr not in PATCHES or not call.args:
        return None
    if not isinstance(function.value, ast.Name) or "patch" not in function.value.id:
        return None
    if function.attr.endswith("item"):
        place = ast.unparse(call.args[0])
        return None if place in DICTIONARIES else place
    words = [one.value for one in call.args[:2] if isinstance(one, ast.Constant) and isinstance(one.value, str)]
    names = [word.rsplit(".", 1)[-1] for word in words]
    return next((name for name in names if is_private(name) or is_constant(name)), None)


def assigned(node: ast.AST) -> str | None:
    """A constant of a module that is assigned to."""
    targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AugAssign) else []
    constants = (t for t in targets if isinstance(t, ast.Attribute) and is_constant(t.attr))
    return next((ast.unparse(t) for t in constants), None)


def faults(text: str) -> list[str]:
    """``line: name`` of everything that is replaced or reached against the rule."""
    found = []
    for node in ast.walk(ast.parse(text)):
        names = []
        if isinstance(node, ast.Call):
            names = [patched(node)]
        elif isinstance(node, ast.Attribute) and is_private(node.attr):
            own = isinstance(node.value, ast.Name) and node.value.id in ("self", "cls")
            names = [] if own else [ast.unparse(node)]
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("lightwell"):
            names = [alias.name for alias in node.names if is_private(alias.name)]
        found += [f"{node.lineno}: {name}" for name in [*names, assigned(node)] if name]
    return found


@pytest.mark.parametrize("path", sorted(FOLDER.rglob("*.py")), ids=lambda path: str(path.relative_to(FOLDER)))
def test_no_constant_is_replaced_and_no_private_name_reached(path):
    assert not faults(path.read_text())


@pytest.mark.parametrize(
    "line",
    [
        'monkeypatch.setattr(radiance, "LAUNCH", 4)',
        'monkeypatch.setattr("lightwell.transport.radiance.LAUNCH", 4)',
        'monkeypatch.setattr(generator, "_shipped", None)',
        'patch.setitem(lightmap.PRESETS, "plain", 1)',
        "radiance.LAUNCH = 4",
        "fit._data = 4",
        "print(fit._data)",
        "from lightwell.probes.samples import _times",
    ],
)
def test_what_is_forbidden_is_found(line):
    assert faults(line)


def test_what_is_allowed_is_not_found():
    allowed = (
        'monkeypatch.setattr(os, "fsync", full)\nmonkeypatch.setitem(sys.modules, "x", 1)\nself._x = Y.Z\nSIZE = 4\n'
    )
    assert not faults(allowed)
