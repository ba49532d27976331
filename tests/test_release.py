"""The release tool: versions agree, notes are cut, wheels are checked, sums are right; what workflows cover."""

import hashlib
import json
import re
import shutil
import zipfile

import pytest
import release
import yaml

from lightwell.cli.main import verb_parser

ROOT = release.ROOT


def test_all_places_have_one_version_and_notes_exist():
    number = release.version()
    notes = release.notes(number)
    assert notes.startswith(f"## {number}") and "\n## " not in notes
    with pytest.raises(ValueError, match=r"CHANGELOG\.md has no section '## 9\.9'; write one"):
        release.notes("9.9")


def _wheel(path, names, padding=0):
    with zipfile.ZipFile(path, "w") as archive:
        for name in names:
            archive.writestr(name, b"")
        archive.writestr("padding", b"\0" * padding)
    return path


def test_a_wheel_is_checked(tmp_path):
    whole = [f"lightwell/{name}" for name in release.NEEDED]
    release.check_wheel(_wheel(tmp_path / "good.whl", whole))
    with pytest.raises(ValueError, match=r"lacks viewer/index.html; build the viewer"):
        release.check_wheel(_wheel(tmp_path / "poor.whl", whole[1:]))
    with pytest.raises(ValueError, match="more than 10,000,000; find what grew"):
        release.check_wheel(_wheel(tmp_path / "large.whl", whole, release.MOST_WHEEL))


def test_sums_are_those_of_the_files(tmp_path):
    (tmp_path / "a").write_bytes(b"one")
    release.write_sums(tmp_path)
    release.write_sums(tmp_path)
    assert (tmp_path / release.SUMS).read_text() == f"{hashlib.sha256(b'one').hexdigest()}  a\n"


def test_the_address_of_the_project_is_written_everywhere_once(tmp_path):
    places = ("pyproject.toml", "web/runtime/package.json", "CITATION.cff")
    (tmp_path / "web/runtime").mkdir(parents=True)
    for place in places:
        shutil.copy(ROOT / place, tmp_path / place)
    before = (tmp_path / places[1]).read_text()
    release.set_repository("https://example.org/old", tmp_path)
    once = [(tmp_path / place).read_text() for place in places]
    release.set_repository("https://example.org/lightwell", tmp_path)
    texts = [(tmp_path / place).read_text() for place in places]
    assert texts == [text.replace("example.org/old", "example.org/lightwell") for text in once]
    assert '[project.urls]\nRepository = "https://example.org/lightwell"\n' in texts[0]
    assert json.loads(before).items() < json.loads(texts[1]).items() and "lightwell.git" in texts[1]
    assert yaml.safe_load(texts[2])["repository-code"] == "https://example.org/lightwell"
    with pytest.raises(ValueError, match="expected an address like"):
        release.set_repository("lightwell", tmp_path)


def test_workflows_cover_the_versions_that_are_supported():
    text = (ROOT / "pyproject.toml").read_text()
    supported = set(re.findall(r"Python :: (3\.\d+)", text))
    jobs = yaml.safe_load((ROOT / ".github/workflows/tests.yml").read_text())["jobs"]
    matrix = jobs["linux"]["strategy"]["matrix"]["include"]
    assert {entry["python"] for entry in matrix} == supported and f'>={min(supported, key=_minor)}"' in text
    assert {entry["node"] for entry in matrix} == {"20", "22", "24"}
    others = yaml.safe_load((ROOT / ".github/workflows/other-platforms.yml").read_text())
    assert "never run" in others["name"] and set(others["jobs"]) == {"macos", "windows"}


def _minor(version):
    return int(version.split(".")[1])


@pytest.mark.parametrize("name", sorted(path.name for path in (ROOT / ".github").rglob("*.yml")))
def test_files_of_the_forge_are_yaml(name):
    (path,) = (ROOT / ".github").rglob(name)
    assert isinstance(yaml.safe_load(path.read_text()), dict)


def _commands(path):
    """The lines of all `run:` steps of a workflow."""
    for job in yaml.safe_load(path.read_text())["jobs"].values():
        for step in job["steps"]:
            yield from (line.strip() for line in step.get("run", "").splitlines() if line.strip())


@pytest.mark.parametrize("path", sorted((ROOT / ".github/workflows").glob("*.yml")), ids=lambda path: path.stem)
def test_commands_of_workflows_exist(path):
    """Targets of make, folders of tests, extras; and who reads the file is told that it has never run."""
    assert "NEVER RUN" in path.read_text().split("\non:")[0]
    targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    lines = list(_commands(path))
    assert lines
    for line in lines:
        words = line.split()
        assert words[0] != "make" or not set(words[1:]) - set(targets), line
        missing = [word for word in words if word.startswith("tests/") and not (ROOT / word).exists()]
        assert not missing, line
        if words[0] == "lightwell":
            verb_parser(words[1], words[2:]).parse_args(words[2:])


def test_the_dockerfile_copies_what_the_wheel_is_built_from():
    text = (ROOT / "Dockerfile").read_text()
    assert "Never built" in text.splitlines()[0] and "COPY . /src" in text and "pip install" in text
    left_out = (ROOT / ".dockerignore").read_text().split()
    assert not {"lightwell", "pyproject.toml", "README.md", "LICENSE", "THIRD_PARTY.md"} & set(left_out)
    (image,) = re.findall(r"^FROM python:(3\.\d+)-slim$", text, re.MULTILINE)
    assert f"Python :: {image}" in (ROOT / "pyproject.toml").read_text()
    assert "The `Dockerfile` has never been built" in (ROOT / "docs/tutorials/install.md").read_text()
