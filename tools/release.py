"""Build everything that a release consists of, and check it: `make release` runs `python tools/release.py`.

Writes to dist/: source distribution and wheel, the npm package, the documentation site, the manual page, the notes of
this version from CHANGELOG.md, a bill of materials (CycloneDX) and SHA-256 sums of all. Nothing is uploaded.

    python tools/release.py --repository https://example.org/lightwell

writes the addresses of the project into the metadata of both packages and into CITATION.cff, and builds nothing.
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


def set_repository(address: str, root: Path = ROOT) -> None:
    """Write the addresses of the project into pyproject.toml, package.json and CITATION.cff, in place of older ones.

    Args:
        address: Address of the repository, https.
        root: The checkout.

    Raises:
        ValueError: The address is none of https.
    """
    if not re.fullmatch(r"https://[\w.-]+(/[\w.~-]+)+", address):
        raise ValueError(f"release: expected an address like https://example.org/lightwell, found '{address}'")
    urls = {"Repository": address, "Issues": f"{address}/issues", "Changelog": f"{address}/blob/main/CHANGELOG.md"}
    table = "[project.urls]\n" + "".join(f'{name} = "{url}"\n' for name, url in urls.items())
    python = re.sub(r"^\[project\.urls\]\n(.+\n)+\n", "", (root / "pyproject.toml").read_text(), flags=re.MULTILINE)
    (root / "pyproject.toml").write_text(python.replace("[project.scripts]\n", f"{table}\n[project.scripts]\n", 1))
    package = root / "web/runtime/package.json"
    facts = json.loads(package.read_text())
    facts["repository"] = {"type": "git", "url": f"git+{address}.git", "directory": "web/runtime"}
    facts |= {"homepage": address, "bugs": urls["Issues"]}
    package.write_text(json.dumps(facts, indent=2, ensure_ascii=False) + "\n")
    citation = re.sub(r"^repository-code:.*\n", "", (root / "CITATION.cff").read_text(), flags=re.MULTILINE)
    (root / "CITATION.cff").write_text(citation.rstrip("\n") + f'\nrepository-code: "{address}"\n')


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
    parser.add_argument("--repository", metavar="URL", help="write the addresses of the project; build nothing")
    given = parser.parse_args()
    if given.repository:
        set_repository(given.repository)
        return
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
    if "[project.urls]" not in (ROOT / "pyproject.toml").read_text():
        print("the metadata has no addresses yet: python tools/release.py --repository URL writes them")


if __name__ == "__main__":
    main()
