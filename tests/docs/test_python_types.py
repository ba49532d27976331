"""Python snippets of README and docs have the types of the package: those of a page are one module for mypy."""

import subprocess
import sys

import pytest

from .snippets import PAGES, ROOT, snippets

# Packages without types, and Mitsuba, whose types depend on the variant, are Any.
CONFIG = """
[mypy]
python_version = 3.10
follow_imports = silent
ignore_missing_imports = true
# What lightwell.read returns depends on the file.
disable_error_code = union-attr
[mypy-mitsuba.*,drjit.*,mitsuba_oidn.*,sklearn.*,scipy.*]
follow_imports = skip
"""
WRONG = 'import lightwell\nlightwell.bake("cornell", "out").verdikt\n'


@pytest.mark.slow
def test_snippets_have_the_types_of_the_package(tmp_path):
    sessions = {"wrong.py": WRONG}
    for page in PAGES:
        texts = [f"# {s.where}\n{s.text}\n" for s in snippets(page) if s.language == "python"]
        if texts:
            name = str(page.relative_to(ROOT)).removesuffix(".md").replace("/", "_").replace("-", "_").lower()
            sessions[f"{name}.py"] = "\n".join(texts)
    assert len(sessions) > 6
    for name, text in sessions.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "mypy.ini").write_text(CONFIG)
    command = [sys.executable, "-m", "mypy", "--config-file", str(tmp_path / "mypy.ini"), "--cache-dir", str(tmp_path)]
    done = subprocess.run(
        [*command, *(str(tmp_path / name) for name in sessions)], cwd=ROOT, capture_output=True, text=True, timeout=1800
    )
    wrong = [line for line in done.stdout.splitlines() if ": error:" in line]
    assert any("verdikt" in line for line in wrong), done.stdout + done.stderr
    assert not [line for line in wrong if "verdikt" not in line]
