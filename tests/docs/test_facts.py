"""What the documents state is what the code has: versions, limits, presets, files, variables, paths, defaults."""

import dataclasses
import json
import re
from collections.abc import Sequence
from fractions import Fraction
from importlib import import_module
from itertools import pairwise
from pathlib import Path

import pytest

import lightwell
from lightwell.asset.records import VERSION_WITH_LAMPS_OR_SKY
from lightwell.cache.settings import OPTIONS
from lightwell.cli.interrupts import INTERRUPTED
from lightwell.cli.main import USAGE_ERROR, VERBS, verb_parser
from lightwell.cli.whole_parser import whole_verbs
from lightwell.core.scene_options import BUILTINS, SCENE_SUFFIXES, UNITS
from lightwell.fields.budget import DEFAULT_QUALITY, QUALITY_SECONDS
from lightwell.fields.lightmap.fit import PRESETS as LIGHT_MAPS
from lightwell.fields.probes.fit import MOST_BESIDE_BRICKS
from lightwell.fields.probes.fit import PRESETS as PROBES
from lightwell.fields.registry import BUILT_IN, PRESETS, QUALITY_PRESETS
from lightwell.fields.surface.factored import PRESETS as FACTORED
from lightwell.fields.surface.plan import RAYS
from lightwell.limits import Limits

from .snippets import PAGES, ROOT

DOCS = ROOT / "docs"
REFERENCE = (DOCS / "reference/command-line.md").read_text()
# Format, as docs/reference/versions.md calls it → module that holds its VERSION.
FORMATS = {
    "`LIGHTWELL_neural_radiance`, the glTF extension": "lightwell.asset.records",
    "shading graph": "lightwell.graph.serial",
    "probe volume, `.lwp`": "lightwell.probes.file",
    "library of spreadlets, `.lwsp`": "lightwell.lens.library",
    "radiance cache, `.npz`": "lightwell.cache.persist",
    "`report.json`": "lightwell.report.summary",
    "`compare.json`": "lightwell.report.comparison",
}
# Folders in which a path that a document names may lie, and names of files that commands write.
FOLDERS = (
    "",
    "lightwell",
    "web",
    "docs",
    "lightwell/probes",
    "lightwell/lens",
    "benchmarks",
    "benchmarks/results",
    "format",
)
WRITTEN = {
    *(
        "index.html",
        "report.html",
        "report.json",
        "compare.html",
        "compare.json",
        "probes.html",
        "rebake.json",
        "edits.json",
    ),
    *("animation.json", "bake.json", "radiance-cache.npz", "OUT.json", "TOPIC.json", "lightwell-viewer.js"),
    *("batch.html", "batch.json"),
    "lightwell-aframe.js",
    "lightwell.js",
}
PATH = re.compile(r"`([\w./-]+\.(?:py|ts|tsx|mjs|md|json|js|html|npz|yml|sh))`")


def _table(text: str, columns: int) -> list[list[str]]:
    rows = [[cell.strip() for cell in line.strip("| \n").split(" | ")] for line in text.splitlines() if line[:1] == "|"]
    return [row for row in rows if len(row) == columns]


def test_versions_of_formats():
    rows = {row[0]: row[1] for row in _table((DOCS / "reference/versions.md").read_text(), 3)[1:]}
    versions = {name: str(import_module(module).VERSION) for name, module in FORMATS.items()}
    extension = "`LIGHTWELL_neural_radiance`, the glTF extension"
    what = "lamps, a sky, nodes, clips, probes or an environment that turns"
    versions[extension] += f", or {VERSION_WITH_LAMPS_OR_SKY} with {what}"
    assert rows == versions
    for page, name in (("PROBES", "probe volume, `.lwp`"), ("LENS", "library of spreadlets, `.lwsp`")):
        assert f"\nVersion {rows[name]}." in (ROOT / f"format/{page}.md").read_text()


def test_limits_of_files():
    text = (DOCS / "scenes.md").read_text()
    defaults = {field.name: field.default for field in dataclasses.fields(Limits)}
    shown = {
        "file_bytes": "8.59 GB",
        "decoded_bytes": "2.15 GB",
        "texels": "1.2 · 10⁹",
        "vertices": "32 · 10⁶",
        "seconds": "300",
    }
    assert defaults["file_bytes"] == 8 << 30 and defaults["decoded_bytes"] == 2 << 30 and defaults["seconds"] == 300
    assert defaults["texels"] == 1.2e9 and defaults["vertices"] == 32e6 and defaults["indices"] == 96e6
    for name, value in shown.items():
        (row,) = [line for line in text.splitlines() if line.startswith("|") and f"`{name}`" in line.split("|")[1]]
        assert value in row
    assert (defaults["nodes"], defaults["instances"], defaults["lights"]) == (500_000, 500_000, 10_000)
    assert f"| `work` | {defaults['work']:,} |" in text
    assert not [name for name in defaults if f"`{name}`" not in text]


def test_warnings_of_scenes_are_those_of_the_code():
    """Most pairs of words of each documented warning stand in one message of the code, around its values."""
    code = "\n".join(path.read_text() for path in sorted((ROOT / "lightwell").rglob("*.py")))
    code = re.sub(r"\{[^{}]*\}", " … ", re.sub(r'"\s*\n\s*f?"', "", code))
    tables = re.findall(r"\| the warning says \|\n\|[-|]+\n((?:\|.*\n)+)", (DOCS / "scenes.md").read_text())
    phrases = [p for table in tables for row in _table(table, 2) for p in re.findall(r"`([^`]+)`", row[1])]
    assert len(phrases) > 30 and _known("dropped n of m triangles, which have no area", code) > 0.6
    assert _known("its surface is washed away by rain", code) < 0.6
    assert not [phrase for phrase in phrases if _known(phrase, code) < 0.6]


def _known(phrase: str, code: str) -> float:
    words = phrase.split()
    pairs = [f"{a} {b}" for a, b in pairwise(words) if not re.search(r"…|\d|_|\b[nm]\b", a + b)]
    return sum(pair in code for pair in pairs) / max(len(pairs), 1) if pairs else 1.0


def test_names_of_the_package_are_in_the_reference():
    text = (DOCS / "python.md").read_text() + (DOCS / "reference/python.md").read_text()
    assert not [name for name in lightwell.__all__ if not re.search(rf"\b{name}\b", text) and name != "__version__"]


def test_presets_are_in_their_tables():
    probes, maps = ((DOCS / name).read_text() for name in ("light-probes.md", "neural-lightmaps.md"))
    assert not [name for name in PRESETS["probes"] if f"`{name}`" not in probes]
    assert not [name for name in PRESETS["lightmap"] if f"`{name}`" not in maps]


def test_fields_scenes_units_and_exit_codes():
    bake = (DOCS / "how-to/bake.md").read_text()
    (row,) = [line for line in bake.splitlines() if line.startswith("| `--field NAME`")]
    assert re.findall(r"`([a-z-]+)`", row.split("|")[2])[: len(BUILT_IN)] and not [
        f for f in BUILT_IN if f"`{f}`" not in row
    ]
    assert f"`{next(iter(BUILT_IN))}` (default)" in row
    scenes = (DOCS / "scenes.md").read_text()
    assert not [
        suffix for suffix in SCENE_SUFFIXES if f"`{suffix}`" not in REFERENCE or suffix.strip(".") not in scenes.lower()
    ]
    assert not [name for name in BUILTINS if f"| `{name}` |" not in scenes] and "|".join(UNITS) in scenes
    assert f"| {USAGE_ERROR} | a mistake" in REFERENCE and f"| {INTERRUPTED} | Ctrl-C" in REFERENCE


def test_verbs_that_end_with_1_are_in_the_table_of_exit_codes():
    (row,) = [line for line in REFERENCE.splitlines() if line.startswith("| 1 |")]
    finders = [verb for verb in VERBS if re.search(r"\b1 where", import_module(f"lightwell.cli.{verb}").run.__doc__)]
    assert len(finders) > 2 and not [verb for verb in finders if f"`{verb}" not in row]


def test_environment_variables():
    rule = re.compile(r"\b(?:LIGHTWELL_[A-Z_]+|DRJIT_LIBLLVM_PATH)\b")
    used = {name for path in (ROOT / "lightwell").rglob("*.py") for name in rule.findall(path.read_text())}
    table = {row[0].strip("`") for row in _table(REFERENCE, 2) if rule.search(row[0])}
    assert table == used


def test_every_dependency_is_named_with_its_licence():
    text = (ROOT / "pyproject.toml").read_text()
    (block,) = re.findall(r"^dependencies = \[\n(.*?)^\]", text, re.MULTILINE | re.DOTALL)
    names = re.findall(r'^  "([A-Za-z0-9-]+)', block, re.MULTILINE)
    table = (ROOT / "THIRD_PARTY.md").read_text().lower()
    assert len(names) > 15 and not [name for name in names if name.lower() not in table]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_files_that_documents_name_exist(page):
    text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
    missing = [
        name
        for name in PATH.findall(text)
        if Path(name).name not in WRITTEN and not any((folder / name).exists() for folder in _folders(page))
    ]
    assert not missing


def _folders(page: Path) -> list[Path]:
    return [page.parent, *(ROOT / folder for folder in FOLDERS)]


def test_functions_of_the_theory_are_in_their_files():
    text = (DOCS / "theory.md").read_text()
    table = text[text.index("## Where it is") : text.index("## Sources")]
    found = re.findall(r"`([\w/]+\.py)`((?: `[\w.]+`,?)*)", table)
    assert len(found) > 25
    for path, names in found:
        code = (ROOT / "lightwell" / path).read_text()
        for name in re.findall(r"`([\w.]+)`", names):
            assert re.search(rf"(?:def|class) {name.split('.')[-1]}\b", code), f"{path} has no {name}"


def test_qualities_are_those_of_the_code():
    text = (DOCS / "how-to/bake.md").read_text()
    rows = {row[0].strip("`"): row for row in _table(text, 7)}
    times = {"30 s": 30, "3 min": 180, "20 min": 1200}
    assert {name: times[row[1].removeprefix("about ")] for name, row in rows.items() if name in QUALITY_SECONDS} == {
        name: int(seconds) for name, seconds in QUALITY_SECONDS.items()
    }
    assert f"`{DEFAULT_QUALITY}` is the default" in text
    # Presets by quality: the table has columns for three fields, a sentence names the others.
    (row,) = [line for line in text.splitlines() if line.startswith("| quality |")]
    assert not [f for f in QUALITY_PRESETS if f"`{f}`" not in row + text[text.index("The bytes are those") :][:500]]


def test_sizes_of_qualities_are_those_of_the_presets():
    words, digits = {"three": 3, "four": 4, "five": 5}, str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹", "0123456789")
    rows = {row[0].strip("`"): row for row in _table((DOCS / "how-to/bake.md").read_text(), 7)}
    for quality in QUALITY_SECONDS:
        _, _, _, grid, rays, texels, _ = rows[quality]
        levels, entries = re.match(r"(\w+) levels, 2([⁰-⁹¹²³]+) entries", grid).groups()
        factored = FACTORED[QUALITY_PRESETS["factored"].get(quality, "default")].grid
        assert (factored.levels, factored.entries_log2) == (words[levels], int(entries.translate(digits)))
        assert RAYS[quality] == int(rays)
        size = LIGHT_MAPS[QUALITY_PRESETS["lightmap"].get(quality, "default")].size
        assert texels.split(" ")[0] == f"{size}²"


def test_the_address_of_the_page():
    """Options of the page's address, its modes and what it compares with."""
    source = (ROOT / "web/viewer/src/options.ts").read_text()
    read = set(re.findall(r'query\.get\("(\w+)"\)', source))
    text = (ROOT / "web/README.md").read_text()
    table = set(re.findall(r"`(\w+)=", text[text.index("| option |") : text.index("Until the learned light")]))
    assert len(read) > 10 and table <= read and not [name for name in read if f"`{name}" not in text + _web()]
    for constant, file in (("MODES", "modes"), ("AGAINST", "modes"), ("TONE_MAPPINGS", "tone-mapping")):
        code = (ROOT / f"web/viewer/src/{file}.ts").read_text()
        names = re.findall(r'"([\w-]+)"', re.search(rf"{constant} = \[(.*?)\]", code)[1])
        assert names and not [name for name in names if f"`{name}`" not in text], constant
    used = re.findall(r"index\.html\?([^`\s]+)`", (DOCS / "tutorials/a-page-that-you-mail.md").read_text())
    assert used and {part.split("=")[0] for address in used for part in address.split("&")} <= read


def _web() -> str:
    return (DOCS / "web.md").read_text()


def test_terms_of_reports_are_in_the_glossary():
    entries = (DOCS / "glossary.md").read_text().lower()
    names = {part.strip() for line in entries.splitlines() if not line.startswith(" ") for part in line.split(",")}
    terms = re.findall(r'^  "([^"]+)": ', (ROOT / "lightwell/report/templates/terms.html").read_text(), re.MULTILINE)
    terms += re.findall(r'^  "([^"]+)": ', (ROOT / "lightwell/report/templates/compare.html").read_text(), re.MULTILINE)
    assert len(terms) > 15
    singular = {term: re.sub(r"(?<=ch)es$|(?<=h)s$|(?<=t)s$", "", term.lower().split(",")[0]) for term in terms}
    assert not [term for term, name in singular.items() if name not in names and name != "bytes"]
    # Modes of the page, whose labels leave "light" out.
    modes = re.findall(r'label: "(\w+)"', (ROOT / "web/viewer/src/modes.ts").read_text())
    lower = [mode.lower().removesuffix("s") for mode in modes]
    assert len(modes) > 5 and not [one for one in lower if not names & {one, f"{one} light"}]


def test_defaults_in_the_pages_of_verbs_are_those_of_the_help():
    """Numbers in parentheses in the row of one or several options are their defaults, in this order."""
    checked = set()
    for verb, *tool in whole_verbs():
        page = (DOCS / f"how-to/{verb}.md").read_text()
        helps = _helps(verb, tool)
        for cell, text in re.findall(r"^\| (`--[a-z][^|]*) \| ([^|]*) \|", page, re.MULTILINE):
            flags = re.findall(r"`(--[a-z-]+)", cell)
            numbers = re.findall(r"\(([\d.]+)\)", text)
            if len(numbers) == len(flags) and all(flag in helps for flag in flags):
                told = [_default(helps[flag]) for flag in flags]
                assert told == [None] * len(flags) or [float(n) for n in numbers] == told, f"{verb} {flags}: {told}"
                checked |= set(flags)
    assert {"--mips", "--longest", "--noise", "--size"} <= checked


def _helps(verb: str, tool: Sequence[str] = ()) -> dict[str, str]:
    actions = verb_parser(verb, tool)._actions
    return {
        flag: (action.help or "").replace("%(default)s", str(action.default))
        for action in actions
        for flag in action.option_strings
    }


def _default(text: str) -> float | None:
    found = re.search(r"\(default:? ([\d.]+)\)", text)
    return float(found[1]) if found else None


def test_options_in_tables_of_a_verb_are_its_own():
    of_verb: dict[str, set[str]] = {}
    for verb, *tool in whole_verbs():
        of_verb.setdefault(verb, set()).update(verb_parser(verb, tool)._option_string_actions)
    for verb, known in of_verb.items():
        page = (DOCS / f"how-to/{verb}.md").read_text()
        cells = re.findall(r"^\| (`--[a-z][^|]*) \|", page, re.MULTILINE)
        assert not [flag for cell in cells for flag in re.findall(r"`(--[a-z-]+)", cell) if flag not in known], verb


def test_options_of_the_radiance_cache_and_their_defaults():
    found = {}
    for row in _table((DOCS / "radiance-cache.md").read_text(), 3):
        names = re.findall(r"`(\w+)`", row[0])
        if names and names[0] in OPTIONS:
            found |= dict(zip(names, (_value(text) for text in row[1].split(", ")), strict=True))
    defaults = {name: declared.default for name, (_, declared, _) in OPTIONS.items()}
    assert found == defaults


def _value(text: str) -> object:
    text = text.strip("`")
    if text in ("true", "false"):
        return text == "true"
    return float(Fraction(text)) if re.fullmatch(r"-?[\d./]+", text) else text


def test_bases_of_the_finest_probes():
    page = (DOCS / "light-probes.md").read_text()
    (row,) = re.findall(r"^\| `fine` .*$", page, re.MULTILINE)
    assert f"at most {PROBES['fine'].rank} bases, or {MOST_BESIDE_BRICKS} where cells have bricks" in row
    (row,) = re.findall(r"^\| a sun, a day, .*$", page, re.MULTILINE)
    assert f"at most {MOST_BESIDE_BRICKS} where cells have bricks" in row


def test_defaults_of_a_day():
    defaults = dict((row[0].strip("`").split(" ")[0], row[2]) for row in _table((DOCS / "day.md").read_text(), 3)[1:])
    helps = _helps("bake")
    assert set(defaults) == {"--north", "--turbidity"}
    for flag, value in defaults.items():
        assert re.search(rf"\(default: {value}\b", helps[flag])


def test_extras_that_documents_and_messages_name_exist():
    text = (ROOT / "pyproject.toml").read_text()
    (block,) = re.findall(r"^\[project\.optional-dependencies\]\n(.*?)\n\n", text, re.MULTILINE | re.DOTALL)
    extras = set(re.findall(r"^(\w+) = ", block, re.MULTILINE))
    files = [*PAGES, *(ROOT / "lightwell").rglob("*.py")]
    named = {name for path in files for name in re.findall(r"lightwell\[([a-z0-9]+)\]", path.read_text())}
    assert {"usd", "ktx2", "cluster"} <= named <= extras


def test_figures_of_the_readme_are_measured():
    rows = json.loads((ROOT / "benchmarks/results/main_job.json").read_text())
    (demo,) = [row["note"] for row in rows if row["what"].startswith("make demo")]
    text = (ROOT / "README.md").read_text()
    beside = text[text.index("*The page that `make demo`") : text.index("## Install")]
    shown = re.findall(r"([\d.]+) %", beside)
    assert len(shown) == 2 and shown == re.findall(r"([\d.]+)%", demo)
