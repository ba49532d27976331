"""Figures of the code itself: size, imports, docstrings, types, long functions and files, and how fast it starts.

python benchmarks/architecture.py            every figure; writes results/architecture.json
python benchmarks/architecture.py --quick    prints them without the timings; writes nothing
python benchmarks/architecture.py --list     also names every place that counts against a figure
python benchmarks/architecture.py --test-log F --test-all-log F --test-web-log F
                                             rows of what these commands of make printed, nothing else
"""

from __future__ import annotations

import argparse
import ast
import io
import re
import subprocess
import sys
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from time import perf_counter

sys.path.insert(0, str(Path(__file__).parent))

from rows import Row, at_most, publish, without_bar

ROOT = Path(__file__).resolve().parents[1]
PACKAGE, WEB = ROOT / "lightwell", ROOT / "web"
# Bars of the issue "One bake pipeline, a public Python API, plain language".
TEST_SECONDS, TEST_ALL_SECONDS, TEST_WEB_SECONDS = 600, 3600, 240
MOST_LINES, MOST_LONG_FUNCTIONS, LONG_FUNCTION, LONG_FILE = 27_300, 10, 40, 400
LONG_CLASS, MOST_MEMBERS = 250, 15
# Options of pydoclint: Google style, types stand in the signature, private functions are free.
PYDOCLINT = (
    "--style=google",
    "--arg-type-hints-in-docstring=False",
    "--check-return-types=False",
    "--check-yield-types=False",
    "--check-class-attributes=False",
    "--allow-init-docstring=True",
    "--skip-checking-short-docstrings=False",
    "--skip-checking-private-functions=True",
    "--ignore-private-args=True",
)
# Functions of the public API document the errors that reach the caller, most of which are raised further below.
FACADE = "lightwell/api.py"
# Annotations of arrays, whose docstring entry must give a shape such as [N, 3].
ARRAY = re.compile(r"ndarray|TensorXf|\bArray\b")
SHAPE = re.compile(r"\[[^\]]*\]|scalar|any shape|shape of|same shape|like ``")


@dataclass
class Findings:
    """What was found, with the places that count against each figure."""

    lines: int = 0
    public: int = 0
    """Public functions and methods."""
    undocumented: list[str] = field(default_factory=list)
    shapeless: list[str] = field(default_factory=list)
    untyped: list[str] = field(default_factory=list)
    long_functions: list[str] = field(default_factory=list)
    long_files: list[str] = field(default_factory=list)
    long_classes: list[str] = field(default_factory=list)
    wide_classes: list[str] = field(default_factory=list)
    circles: list[str] = field(default_factory=list)
    web_circles: list[str] = field(default_factory=list)


def code_lines(text: str) -> int:
    """Count lines that hold code: no blank line, comment or docstring.

    Args:
        text: Source of a Python module.

    Returns:
        Number of lines.
    """
    held: set[int] = set()
    skipped = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENCODING)
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in (*skipped, tokenize.ENDMARKER):
            held.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)) and _has_docstring(node):
            held.difference_update(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    return len(held)


def functions(tree: ast.AST, prefix: str = "", public: bool = True) -> Iterator[tuple[str, ast.FunctionDef, bool]]:
    """Yield (qualified name, node, whether it is public) of the functions and methods of a module or class."""
    for node in getattr(tree, "body", []):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            yield prefix + node.name, node, public and not node.name.startswith("_")
        elif isinstance(node, ast.ClassDef):
            yield from functions(node, f"{prefix}{node.name}.", public and not node.name.startswith("_"))


def parameters(node: ast.FunctionDef) -> list[ast.arg]:
    """List the parameters of a function without self, cls and private ones."""
    arguments = node.args
    found = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
    found += [extra for extra in (arguments.vararg, arguments.kwarg) if extra]
    return [a for a in found if a.arg not in ("self", "cls") and not a.arg.startswith("_")]


def _entry(docstring: str, name: str) -> str:
    """The text of a parameter in the Args section."""
    match = re.search(rf"^ *\*{{0,2}}{re.escape(name)}: *(.*(?:\n(?: {{8,}}).*)*)", docstring, re.M)
    return match.group(1) if match else ""


def read_python(found: Findings) -> None:
    """Collect the figures of the package."""
    for path in sorted(PACKAGE.rglob("*.py")):
        text = path.read_text()
        name = str(path.relative_to(ROOT))
        found.lines += code_lines(text)
        tree = ast.parse(text)
        length = text.count("\n") - sum(_docstring_lines(node) for node in ast.walk(tree) if hasattr(node, "body"))
        if length > LONG_FILE:
            found.long_files.append(f"{name} ({length})")
        for node in (n for n in ast.walk(tree) if isinstance(n, ast.ClassDef)):
            _read_class(found, node, f"{name}:{node.lineno} {node.name}")
        for function, node, public in functions(tree):
            where = f"{name}:{node.lineno} {function}"
            if node.end_lineno - node.lineno + 1 - _docstring_lines(node) > LONG_FUNCTION:
                found.long_functions.append(where)
            if public:
                found.public += 1
                _read_public(found, node, where)
    found.circles = circles(python_imports())
    found.undocumented = pydoclint()


def _read_class(found: Findings, node: ast.ClassDef, where: str) -> None:
    length = node.end_lineno - node.lineno + 1 - _docstring_lines(node)
    length -= sum(_docstring_lines(method) for _, method, _ in functions(node))
    if length > LONG_CLASS:
        found.long_classes.append(f"{where} ({length})")
    if len(members := public_members(node)) > MOST_MEMBERS:
        found.wide_classes.append(f"{where} ({len(members)})")


def public_members(node: ast.ClassDef) -> set[str]:
    """List the public attributes, properties and methods of a class that it does not inherit.

    Fields of a record count as one: what it is made from is read in one place, and settings are many by nature.

    Args:
        node: The class.

    Returns:
        Their names; ``fields`` for those of a record.
    """
    names = {method.name for method in node.body if isinstance(method, (ast.FunctionDef, ast.AsyncFunctionDef))}
    record = any("dataclass" in ast.unparse(decorator) for decorator in node.decorator_list)
    if any(isinstance(n, ast.AnnAssign) for n in node.body):
        fields = {n.target.id for n in node.body if isinstance(n, ast.AnnAssign) and isinstance(n.target, ast.Name)}
        names |= {"fields"} if record else fields
    for n in ast.walk(node):
        targets = n.targets if isinstance(n, ast.Assign) else [n.target] if isinstance(n, ast.AnnAssign) else []
        flat = [t for target in targets for t in (target.elts if isinstance(target, ast.Tuple) else [target])]
        own = (t for t in flat if isinstance(t, ast.Attribute) and isinstance(t.value, ast.Name))
        names |= {t.attr for t in own if t.value.id == "self"}
    return {name for name in names if not name.startswith("_")}


def _read_public(found: Findings, node: ast.FunctionDef, where: str) -> None:
    docstring = ast.get_docstring(node) or ""
    for parameter in parameters(node):
        annotation = ast.unparse(parameter.annotation) if parameter.annotation else ""
        if not annotation:
            found.untyped.append(f"{where}({parameter.arg})")
        if ARRAY.search(annotation) and not SHAPE.search(_entry(docstring, parameter.arg)):
            found.shapeless.append(f"{where}({parameter.arg})")


def _has_docstring(node: ast.AST) -> bool:
    first = node.body[0] if isinstance(node.body, list) and node.body else None
    return isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant) and isinstance(first.value.value, str)


def _docstring_lines(node: ast.AST) -> int:
    return node.body[0].end_lineno - node.body[0].lineno + 1 if _has_docstring(node) else 0


def pydoclint() -> list[str]:
    """List the public functions whose docstring misses a parameter, the return value or an error.

    Returns:
        Places as file:line name.
    """
    command = [str(Path(sys.executable).parent / "pydoclint"), *PYDOCLINT, "-q", "lightwell"]
    text = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    found, name = [], ""
    for line in (text.stdout + text.stderr).splitlines():
        if line.startswith("lightwell/"):
            name = line.strip()
        elif match := re.match(r"\s+(\d+): (DOC\d+): \w+ `([\w.]+)`", line):
            if name == FACADE and match[2] in ("DOC502", "DOC503"):
                continue
            found.append(f"{name}:{match[1]} {match[3]}")
    return sorted({place for place in found if not re.search(r"[ .]_(?!_init__)", place)})


# ---------------------------------------------------------------------- imports


def python_imports() -> dict[str, set[str]]:
    """Map each module to the modules that it imports when it is loaded (imports inside functions do not count)."""
    modules = {_module(path): path for path in PACKAGE.rglob("*.py")}
    graph = {}
    for name, path in modules.items():
        tree = ast.parse(path.read_text())
        wanted: set[str] = set()
        for node in ast.walk(ast.Module([s for s in tree.body if not _for_types(s)], [])):
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
                node.body = []
            elif isinstance(node, ast.Import):
                wanted |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                whole = {f"{node.module}.{alias.name}" for alias in node.names}
                wanted |= {w if w in modules else node.module for w in whole}
        graph[name] = {w for w in wanted if w in modules} - {name}
    return graph


def _module(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _for_types(node: ast.stmt) -> bool:
    return isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)


def web_imports() -> dict[str, set[str]]:
    """Map each TypeScript file of the runtime and the viewer to the files that it imports, types included."""
    files = [
        p for folder in ("runtime", "viewer") for p in (WEB / folder).rglob("*.ts") if "node_modules" not in p.parts
    ]
    known = {p.resolve(): str(p.relative_to(ROOT)) for p in files}
    graph = {}
    for path, name in known.items():
        wanted = re.findall(r"""(?:from|import)\s*\(?\s*["'](\.[^"']+)["']""", path.read_text())
        targets = [(path.parent / w) for w in wanted]
        for patterns in re.findall(r"""import\.meta\.glob[^(]*\(([^)]+)\)""", path.read_text()):
            targets += [
                p for pattern in re.findall(r"""["']\./([^"']+)["']""", patterns) for p in path.parent.glob(pattern)
            ]
        options = [[t, t.with_suffix(".ts"), Path(f"{t}.ts"), t / "index.ts"] for t in targets]
        graph[name] = {known[o.resolve()] for group in options for o in group if o.resolve() in known} - {name}
    return graph


def circles(graph: dict[str, set[str]]) -> list[str]:
    """List the groups of modules that import each other in a circle.

    Args:
        graph: Module to what it imports.

    Returns:
        Names of each strongly connected group of two or more, joined by arrows.
    """
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    groups: list[str] = []

    def visit(name: str) -> None:
        index[name] = low[name] = len(index)
        stack.append(name)
        for other in graph[name]:
            if other not in index:
                visit(other)
            if other in stack:
                low[name] = min(low[name], low[other])
        if low[name] == index[name]:
            at = stack.index(name)
            group = stack[at:]
            del stack[at:]
            if len(group) > 1:
                groups.append(" -> ".join(sorted(group)))

    for name in graph:
        if name not in index:
            visit(name)
    return groups


# ---------------------------------------------------------------------- time


def seconds(*command: str, repeats: int = 7) -> float:
    """Measure the median wall time of a command of this Python.

    Args:
        command: Arguments of the interpreter.
        repeats: Runs.

    Returns:
        Seconds, the interpreter's own start included.
    """
    times = []
    for _ in range(repeats):
        start = perf_counter()
        subprocess.run([sys.executable, *command], cwd=ROOT, check=True, capture_output=True)
        times.append(perf_counter() - start)
    return median(times)


def rows(found: Findings, timed: bool) -> list[Row]:
    """The figures as rows."""
    documented = 1 - len(found.undocumented) / max(found.public, 1)
    result = [
        at_most("code: lines of lightwell/ without blanks, comments and docstrings", MOST_LINES, found.lines, "lines"),
        at_most("code: circles of imports, Python", 0, len(found.circles), "circles"),
        at_most("code: circles of imports, web, types included", 0, len(found.web_circles), "circles"),
        at_most(
            "docstrings: public callables that miss a parameter, a return value or an error",
            0,
            len(found.undocumented),
            "callables",
            f"{documented:.1%} of {found.public} are complete (pydoclint)",
        ),
        at_most("docstrings: array parameters without a shape", 0, len(found.shapeless), "parameters"),
        at_most("types: public parameters without one", 0, len(found.untyped), "parameters"),
        at_most(
            f"code: functions over {LONG_FUNCTION} lines, docstring apart",
            MOST_LONG_FUNCTIONS,
            len(found.long_functions),
            "functions",
        ),
        at_most(f"code: files over {LONG_FILE} lines, docstrings apart", 0, len(found.long_files), "files"),
        at_most(f"code: classes over {LONG_CLASS} lines, docstrings apart", 0, len(found.long_classes), "classes"),
        at_most(
            f"code: classes over {MOST_MEMBERS} public members (the fields of a record count as one)",
            0,
            len(found.wide_classes),
            "classes",
        ),
    ]
    if not timed:
        return result
    empty = seconds("-c", "pass")
    imports, help_ = seconds("-c", "import lightwell"), seconds("-m", "lightwell.cli", "--help")
    note = f"an empty interpreter takes {empty:.3f} s"
    return [
        *result,
        at_most("start: import lightwell", 0.1, imports, "s", note),
        at_most("start: lightwell --help", 0.15, help_, "s", note),
        without_bar("start: an empty interpreter", empty, "s"),
    ]


def test_rows(what: str, bar: float, log: Path) -> Iterator[Row]:
    """Rows of a run of the tests: its wall time, and how many failed.

    Args:
        what: The command.
        bar: Seconds that are allowed.
        log: What ``tools/run_tests.py`` printed.

    Yields:
        Two rows.
    """
    try:
        text = log.read_text()
        seconds, processor = re.findall(r"^all +([0-9.]+) +([0-9.]+)$", text, re.MULTILINE)[-1]
        passed, failed, skipped = re.findall(r"^(\d+) passed, (\d+) failed, (\d+) skipped$", text, re.MULTILINE)[-1]
    except (OSError, IndexError):
        print(f"error: '{log}': expected what {what} prints; write it with '{what} > {log}'", file=sys.stderr)
        raise SystemExit(2) from None
    note = f"{passed} passed, {failed} failed, {skipped} skipped; {processor} s of processor time; installed before"
    yield at_most(f"tests: {what}", bar, float(seconds), "s", note)
    yield at_most(f"tests: failures of {what}", 0, int(failed), "tests", f"{passed} passed, {skipped} skipped")


def main() -> None:
    """Read the code, print the figures and write them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="leave out the timings and write nothing")
    parser.add_argument("--untimed", action="store_true", help="leave out the timings; those that are written stay")
    parser.add_argument("--list", action="store_true", help="name every place")
    parser.add_argument("--test-log", type=Path, help="output of make test, run on a quiet machine")
    parser.add_argument("--test-all-log", type=Path, help="output of make test-all")
    parser.add_argument("--test-web-log", type=Path, help="output of make test-web, run on a quiet machine")
    arguments = parser.parse_args()
    logs = (
        ("make test", TEST_SECONDS, arguments.test_log),
        ("make test-all", TEST_ALL_SECONDS, arguments.test_all_log),
        ("make test-web", TEST_WEB_SECONDS, arguments.test_web_log),
    )
    if given := [row for what, bar, log in logs if log for row in test_rows(what, bar, log)]:
        publish("architecture", given, arguments.quick)
        return
    found = Findings()
    read_python(found)
    found.web_circles = circles(web_imports())
    if arguments.list:
        for title in (name for name, value in vars(found).items() if isinstance(value, list)):
            for place in getattr(found, title):
                print(f"{title}: {place}")
    publish("architecture", rows(found, not (arguments.quick or arguments.untimed)), arguments.quick)


if __name__ == "__main__":
    main()
