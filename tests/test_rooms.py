"""Imports go one way: a package uses only what the table of docs/architecture.md allows it."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "lightwell"
TABLE = re.compile(r"^\| `(\w+)(?:/|\.py)` \| .* \| ([^|]*) \|$", re.MULTILINE)


def _allowed() -> dict[str, set[str]]:
    """Package → packages that it may import, from the table."""
    rows = TABLE.findall((ROOT / "docs/architecture.md").read_text())
    allowed = {name: set(re.findall(r"\w+", words)) for name, words in rows}
    # What every package may import that core itself does not use.
    for name in allowed.keys() - {"core"} - allowed["core"]:
        allowed[name] |= {"core"}
    return allowed


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


def test_packages_import_only_what_the_table_allows():
    wrong, allowed = [], _allowed()
    for path in PACKAGE.rglob("*.py"):
        room = _room(path)
        if room == "__init__":
            continue
        assert room in allowed, f"{path}: a new package; say in the table of docs/architecture.md what it may import"
        extra = _imports(path) - allowed[room] - {room, "__version__"}
        wrong += [f"{path.relative_to(PACKAGE)} imports {name}" for name in sorted(extra)]
    assert not wrong, "\n".join(wrong)


def test_the_table_lists_the_packages_that_are_there():
    there = {path.name.removesuffix(".py") for path in PACKAGE.iterdir() if path.suffix == ".py" or path.is_dir()}
    assert set(_allowed()) == there - {"__init__", "__pycache__"}
