"""Build everything that a release consists of, and check it: `make release` runs `python tools/release.py`.

Writes to dist/: source distribution and wheel, the npm package, the documentation site, the manual page, the notes of
this version from CHANGELOG.md, a bill of materials (CycloneDX) and SHA-256 sums of all. Nothing is uploaded.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
# Largest wheel, bytes.
MOST_WHEEL = 10_000_000
# What a wheel must hold, besides the modules.
NEEDED = ("viewer/index.html", "py.typed", "graph/exporter.js", "lens/standard/", "probes/generator.npz")
SUMS = "SHA256SUMS"


def run(*words: str, cwd: Path = ROOT) -> None:
    """Run a command; a failure ends the release.

    Args:
        *words: The command.
        cwd: Working folder.
    """
    print("$", " ".join(words), flush=True)
    subprocess.run(words, cwd=cwd, check=True)


def version() -> str:
    """Read the version, which all places must agree on.

    Returns:
        The version.

    Raises:
        ValueError: Two places differ.
    """
    places = {
        "lightwell/__init__.py": r'__version__ = "([^"]+)"',
        "pyproject.toml": r'^version = "([^"]+)"',
        "web/runtime/package.json": r'"version": "([^"]+)"',
        "CITATION.cff": r"^version: (\S+)",
    }
    found = {name: re.search(rule, (ROOT / name).read_text(), re.MULTILINE)[1] for name, rule in places.items()}
    if len(set(found.values())) != 1:
        raise ValueError(f"release: versions differ: {found}; make them one")
    return found["pyproject.toml"]


def notes(number: str) -> str:
    """Cut the section of a version out of CHANGELOG.md.

    Args:
        number: The version.

    Returns:
        Its text.

    Raises:
        ValueError: There is no such section.
    """
    text = (ROOT / "CHANGELOG.md").read_text()
    section = re.search(rf"^## {re.escape(number)}\b.*?(?=^## |\Z)", text, re.MULTILINE | re.DOTALL)
    if not section:
        raise ValueError(f"release: CHANGELOG.md has no section '## {number}'; write one")
    return section[0].rstrip() + "\n"


def check_wheel(wheel: Path) -> None:
    """Check the size and the content of the wheel.

    Args:
        wheel: The file.

    Raises:
        ValueError: It is too large, or something is missing.
    """
    size = wheel.stat().st_size
    if size > MOST_WHEEL:
        raise ValueError(f"release: {wheel.name} has {size:,} bytes, more than {MOST_WHEEL:,}; find what grew")
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    missing = [need for need in NEEDED if not any(need in name for name in names)]
    if missing:
        raise ValueError(f"release: {wheel.name} lacks {', '.join(missing)}; build the viewer, or mend package-data")


def write_sums(folder: Path) -> None:
    """Write the SHA-256 sums of all files in a folder.

    Args:
        folder: The folder.
    """
    files = sorted(path for path in folder.iterdir() if path.is_file() and path.name != SUMS)
    lines = [f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in files]
    (folder / SUMS).write_text("".join(lines))


def bill_of_materials(out: Path) -> None:
    """List every distribution that lightwell installs, with version and licence.

    Args:
        out: JSON file to write (CycloneDX).
    """
    run(
        sys.executable,
        "-m",
        "cyclonedx_py",
        "environment",
        "--pyproject",
        "pyproject.toml",
        "--of",
        "JSON",
        "-o",
        str(out),
    )
    json.loads(out.read_text())


def main() -> None:
    """Build and check."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="folder to write (default: dist)")
    parser.add_argument("--without", default="", help="parts to leave out: npm, site, bill, joined by commas")
    given = parser.parse_args()
    out, left_out = given.out.resolve(), set(filter(None, given.without.split(",")))
    number = version()
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    (out / "RELEASE_NOTES.md").write_text(notes(number))
    run(sys.executable, "-m", "build", "--outdir", str(out))
    check_wheel(next(out.glob("*.whl")))
    manual = subprocess.run([sys.executable, "-m", "lightwell", "man"], cwd=ROOT, check=True, capture_output=True)
    (out / "lightwell.1").write_bytes(manual.stdout)
    if "npm" not in left_out:
        run("npm", "run", "build:package", cwd=ROOT / "web")
        run("npm", "pack", "--pack-destination", str(out), cwd=ROOT / "web/runtime")
    if "site" not in left_out:
        site = out / "site"
        run(sys.executable, "-m", "sphinx", "-W", "-q", "-b", "html", "-c", "docs", ".", str(site))
        with tarfile.open(out / f"lightwell-{number}-site.tar.gz", "w:gz") as archive:
            archive.add(
                site, f"lightwell-{number}-site", filter=lambda entry: None if ".doctrees" in entry.name else entry
            )
        shutil.rmtree(site)
    if "bill" not in left_out:
        bill_of_materials(out / f"lightwell-{number}-sbom.json")
    write_sums(out)
    for path in sorted(out.iterdir()):
        print(f"{path.stat().st_size:>12,}  {path.name}")


if __name__ == "__main__":
    main()
