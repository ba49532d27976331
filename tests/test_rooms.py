"""Imports go one way: a stage uses only stages to its left (docs/architecture.md)."""

import ast
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "lightwell"

# Room → rooms that it may import.
ALLOWED = {
    "limits": set(),
    "files": {"limits"},
    "backend": set(),
    "core": {"limits", "files", "backend"},
    "exr": {"limits"},
    "scenes": {"exr", "limits", "files", "backend"},
    "graph": {"backend"},
    "networks": {"files", "backend", "graph"},
    "transport": {"limits", "files", "backend", "scenes"},
    "probes": {"limits", "files", "backend", "scenes", "transport", "graph"},
    "fields": {"files", "backend", "scenes", "transport", "networks", "graph", "probes"},
    "serving": set(),
    "cache": {"limits", "files", "serving", "backend", "scenes", "transport", "networks", "graph"},
    "rendering": {"files", "backend", "scenes", "transport", "cache"},
    "asset": {"limits", "files", "graph", "scenes"},
    "report": {"files", "asset"},
    "doctor": {"backend"},
    "lens": {"limits", "files", "exr", "backend"},
    "baking": {"files", "scenes", "transport", "graph", "fields", "asset", "report", "doctor"},
    "api": {"asset", "baking", "cache", "fields", "limits", "probes", "rendering", "report"},
    "cli": {"files", "fields", "asset", "baking", "rendering", "cache", "doctor", "lens", "serving"},
    "__main__": {"cli"},
}

# What every package may import that core itself does not use.
for _name in ALLOWED.keys() - {"core"} - ALLOWED["core"]:
    ALLOWED[_name] |= {"core"}


def _room(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def _imports(path: Path) -> set[str]:
    """Rooms that a file imports; imports for type checkers do not count."""
    tree = ast.parse(path.read_text())
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            node.body = []
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.level == 0 and (node.module or "").startswith("lightwell"):
            names |= {node.module} if node.module != "lightwell" else {f"lightwell.{a.name}" for a in node.names}
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names if alias.name.startswith("lightwell.")}
    return {name.split(".")[1] for name in names if "." in name}


def test_rooms_import_only_rooms_to_their_left():
    wrong = []
    for path in PACKAGE.rglob("*.py"):
        room = _room(path)
        if room == "__init__":
            continue
        assert room in ALLOWED, f"{path}: a new room; say in this test what it may import"
        extra = _imports(path) - ALLOWED[room] - {room, "__version__"}
        wrong += [f"{path.relative_to(PACKAGE)} imports {name}" for name in sorted(extra)]
    assert not wrong, "\n".join(wrong)
