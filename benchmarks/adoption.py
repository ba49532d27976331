"""What a newcomer meets: sizes of installation and wheel, answers to mistakes, links and snippets of the docs.

    python benchmarks/adoption.py [--only size,wheel,fresh,mistakes,links,pages,readme,snippets] [--quick] [--report F]

`snippets` runs every command and Python snippet of the documents (tests/docs/test_snippets_run.py), which takes long;
`--report F` counts what a report F of `make test-all REPORTS=FOLDER` says of them (FOLDER/tests-docs.report).
`fresh` downloads all packages, installs them into a fresh environment without a network, and runs the demo.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import re
import subprocess
import sys
import tempfile
import time
import venv
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

from packaging.requirements import Requirement
from rows import Row, at_least, at_most, chosen, publish

ROOT = Path(__file__).parents[1]
MISTAKE = """
import sys, time
from lightwell.cli import main
try:
    code = main(sys.argv[1:])
except SystemExit as ended:
    code = ended.code
print(code, time.process_time())
"""
# The test that runs the snippets of a page.
SNIPPETS = "test_snippets_run"
FRESH = "wheel alone in a fresh environment to the page of the demo"
MISTAKES = ("bakee cornell", "bake cornel -o x", "bake cornell -o x --field mpl", "bake cornell -o x --bugdet 5m")


def installed_bytes() -> dict[str, int]:
    """Measure lightwell and all that it installs, without compiled Python.

    Returns:
        Bytes by distribution.
    """
    sizes = {"lightwell": sum(f.stat().st_size for f in (ROOT / "lightwell").rglob("*") if _counts(f))}
    waiting = ["lightwell"]
    seen: set[str] = set()
    while waiting:
        name = re.sub(r"[-_.]+", "-", waiting.pop()).lower()
        if name in seen:
            continue
        seen.add(name)
        distribution = importlib.metadata.distribution(name)
        if name != "lightwell":
            files = [Path(str(file.locate())) for file in distribution.files or []]
            sizes[name] = sum(file.stat().st_size for file in files if _counts(file))
        needs = map(Requirement, distribution.requires or [])
        waiting += [need.name for need in needs if need.marker is None or need.marker.evaluate({"extra": ""})]
    return sizes


def _counts(file: Path) -> bool:
    return file.is_file() and not file.is_symlink() and file.suffix != ".pyc"


def size() -> Iterator[Row]:
    """Measure the installation.

    Yields:
        A row.
    """
    sizes = installed_bytes()
    largest = sorted(sizes, key=sizes.__getitem__, reverse=True)[:5]
    note = ", ".join(f"{name} {sizes[name] / 1e6:.0f} MB" for name in largest)
    yield at_most("installed size, denoiser included", 700, sum(sizes.values()) / 1e6, "MB", note)


def wheel() -> Iterator[Row]:
    """Build the wheel.

    Yields:
        A row.
    """
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", folder, str(ROOT)]
        subprocess.run(command, check=True)
        count = next(Path(folder).glob("*.whl")).stat().st_size
    yield at_most("wheel", 10, count / 1e6, "MB", "")


def fresh() -> Iterator[Row]:
    """Install the wheel alone into a fresh environment, from a folder of wheels, and run the demo.

    Yields:
        A row: seconds until the page is written.
    """
    with tempfile.TemporaryDirectory() as folder:
        wheels, home = Path(folder) / "wheels", Path(folder) / "venv"
        pip = [sys.executable, "-m", "pip"]
        subprocess.run([*pip, "wheel", "-q", "--no-deps", "-w", str(wheels), str(ROOT)], check=True)
        own = str(next(wheels.glob("lightwell-*.whl")))
        subprocess.run([*pip, "download", "-q", "-d", str(wheels), own], check=True)
        start = time.perf_counter()
        venv.create(home, with_pip=True)
        programs = home / ("Scripts" if sys.platform == "win32" else "bin")
        install = [str(programs / "python"), "-m", "pip", "install", "-q", "--no-compile", "--no-index"]
        subprocess.run([*install, "--find-links", str(wheels), "lightwell"], check=True)
        demo = [str(programs / "lightwell"), "demo", "-o", str(Path(folder) / "demo"), "--no-open"]
        subprocess.run(demo, check=True, cwd=folder)
        seconds = time.perf_counter() - start
        assert (Path(folder) / "demo/index.html").is_file()
    yield at_most(FRESH, 180, seconds, "s", "environment, installation and demo; packages were downloaded before")


def readme() -> Iterator[Row]:
    """Look at the README's first screen.

    Yields:
        A row: parts that are seen.
    """
    sys.path.insert(0, str(ROOT / "tools"))
    from first_screen import seen

    found = seen((ROOT / "README.md").read_text())
    note = "moving picture, sentence, two commands at 1280 x 800"
    yield at_least("parts that README's first screen holds", len(found), sum(found.values()), "", note)


def mistakes() -> Iterator[Row]:
    """Time the answers to mistakes in arguments.

    Yields:
        A row: the slowest.
    """
    slowest = 0.0
    for words in MISTAKES:
        command = [sys.executable, "-c", MISTAKE, *words.split()]
        text = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
        code, seconds = text.split()
        assert code == "2", words
        slowest = max(slowest, float(seconds))
    note = f"processor time, start of Python included; slowest of {len(MISTAKES)}"
    yield at_most("answer to a mistake in the arguments", 0.2, slowest, "s", note)


def links() -> Iterator[Row]:
    """Build the site and count warnings: each broken link is one.

    Yields:
        A row.
    """
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "sphinx", "-q", "-b", "html", "-c", "docs", ".", folder]
        said = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stderr
        pages = len(list(Path(folder).rglob("*.html")))
    broken = len(re.findall(r"WARNING|ERROR", said))
    yield at_most("broken links and other warnings of the site", 0, broken, "warnings", f"{pages} pages")


def snippets() -> Iterator[Row]:
    """Run all snippets of the documents.

    Yields:
        A row: the share of pages whose snippets all run.
    """
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        tests = f"tests/docs/test_snippets_run.py::{SNIPPETS}"
        subprocess.run([sys.executable, "-m", "pytest", "-m", "", "-q", tests, f"--junitxml={report}"], cwd=ROOT)
        yield from snippets_of(report)


def snippets_of(report: Path) -> Iterator[Row]:
    """Count the pages whose snippets ran.

    Args:
        report: JUnit XML file of the tests of the documents, slow ones included.

    Yields:
        A row: the share of pages whose snippets all run.
    """
    cases = [case for case in ET.parse(report).iter("testcase") if case.get("name", "").startswith(f"{SNIPPETS}[")]
    passed = sum(not any(case.find(end) is not None for end in ("failure", "error", "skipped")) for case in cases)
    share = 100 * passed / max(len(cases), 1)
    yield at_least("pages whose snippets all run", 100, share, "%", f"{passed} of {len(cases)} pages")


def pages() -> Iterator[Row]:
    """Build the site and check its pages with axe, on a desktop and on a phone.

    Yields:
        Two rows.
    """
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "sphinx", "-q", "-b", "html", "-c", "docs", ".", folder]
        subprocess.run(command, cwd=ROOT, check=True)
        names = [str(path.relative_to(folder)) for path in Path(folder).rglob("*.html") if "_static" not in path.parts]
        names.remove("index.html")  # leads on to docs/index.html
        command = ["node", str(ROOT / "tools/check-site.mjs"), folder, *names]
        text = subprocess.run(command, capture_output=True, text=True).stdout
    found = [json.loads(line) for line in text.splitlines()]
    note = f"{len(names)} pages at 1280 and 390 pixels"
    yield at_most("violations that axe finds on the site", 0, sum(len(page["violations"]) for page in found), "", note)
    yield at_most(
        "pages of the site that scroll sideways", 0, sum(page["sideways"] > 0 for page in found), "pages", note
    )


PARTS = {
    "size": size,
    "wheel": wheel,
    "fresh": fresh,
    "mistakes": mistakes,
    "links": links,
    "pages": pages,
    "readme": readme,
    "snippets": snippets,
}
# Parts that take long: a quick run leaves them out.
LONG = ("fresh", "snippets")


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", help=f"some of {', '.join(PARTS)}")
    parser.add_argument("--quick", action="store_true", help="print, write nothing; without fresh and snippets")
    parser.add_argument("--report", type=Path, help="count the snippets of this report of the tests; run none")
    given = parser.parse_args()
    parts = [part for part in chosen("--only", given.only, PARTS) if not (given.quick and part in LONG)]
    of_report = {} if given.report is None else {"snippets": lambda: snippets_of(given.report)}
    publish("adoption", [row for part in parts for row in (PARTS | of_report)[part]()], given.quick)


if __name__ == "__main__":
    main()
