"""No class of the cache and of rendering does too much."""

import ast
from pathlib import Path

PACKAGE = Path(__file__).parents[2] / "lightwell"
MOST_MEMBERS, MOST_LINES = 15, 250


def members(node: ast.ClassDef) -> set[str]:
    """Public methods, fields, and attributes that methods assign."""
    found = {n.name for n in node.body if isinstance(n, ast.FunctionDef)}
    found |= {n.target.id for n in node.body if isinstance(n, ast.AnnAssign) and isinstance(n.target, ast.Name)}
    for n in ast.walk(node):
        if isinstance(n, ast.Attribute) and isinstance(n.ctx, ast.Store) and isinstance(n.value, ast.Name):
            found |= {n.attr} if n.value.id == "self" else set()
    return {name for name in found if not name.startswith("_") and not name.isupper()}


def test_classes_have_at_most_15_public_members_and_250_lines():
    large = []
    for path in [p for room in ("cache", "rendering") for p in (PACKAGE / room).rglob("*.py")]:
        for node in [n for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.ClassDef)]:
            count, lines = len(members(node)), node.end_lineno - node.lineno + 1
            if count > MOST_MEMBERS or lines > MOST_LINES:
                large.append(f"{path.name}: {node.name} has {count} public members and {lines} lines")
    assert not large, "\n".join(large)
