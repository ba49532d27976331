"""The end of scenes between files; for `make test-all` the wheel, other versions of Python, and Blender."""

from __future__ import annotations

import gc
import shutil
import subprocess
import sys
import venv
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
# What a wheel is made of.
SOURCES = ("lightwell", "pyproject.toml", "README.md", "LICENSE", "THIRD_PARTY.md")
# Releases of the package `bpy`, each of which is a Blender without a window; all want this Python.
BLENDERS, BLENDER_PYTHON = ("4.2.23", "4.5.15", "5.0.1"), "3.11"


def pytest_collection_finish() -> None:
    """Leave what is imported out of later collections of garbage, which then take milliseconds."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="module", autouse=True)
def ended_scenes():
    """The scenes of a file are gone from Mitsuba when the next file begins.

    Dr.Jit compiles the code of all materials that exist into every kernel that asks a material: beside another scene
    the kernels of a room are five times as large, and others than those of a run without it.
    """
    yield
    gc.collect()


def interpreter(version: str) -> str | None:
    """Find an interpreter by its version, such as 3.11; None where this machine has none."""
    homes = sorted(Path.home().glob(f".pyenv/versions/{version}.*/bin/python{version}"), reverse=True)
    for candidate in (shutil.which(f"python{version}"), *map(str, homes)):
        if candidate and subprocess.run([candidate, "-c", "import venv"], capture_output=True).returncode == 0:
            return candidate
    return None


@pytest.fixture(scope="session")
def wheel(tmp_path_factory) -> Path:
    """The wheel of this checkout, built beside it."""
    source, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("wheel")
    for name in SOURCES:
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy2
        copy(ROOT / name, source / name)
    build = [sys.executable, "-m", "pip", "wheel", "-q", "--disable-pip-version-check", "--no-deps", "-w", out, source]
    subprocess.run(build, check=True, timeout=600)
    return next(out.glob("lightwell-*.whl"))


@pytest.fixture(scope="session")
def environment(tmp_path_factory) -> Callable[..., Path]:
    """A function that makes an environment once and returns its Python: (version of Python, packages)."""
    made: dict[tuple[str, ...], Path] = {}

    def make(version: str, *packages: str) -> Path:
        found = interpreter(version)
        if found is None:
            pytest.skip(f"this machine has no Python {version}")
        key = (version, *packages)
        if key not in made:
            home = tmp_path_factory.mktemp("environment")
            subprocess.run([found, "-m", "venv", home], check=True)
            context = venv.EnvBuilder().ensure_directories(home)
            python = Path(context.bin_path) / "python"
            install = [python, "-m", "pip", "install", "-q", "--disable-pip-version-check", "--no-compile", *packages]
            subprocess.run(install, check=True, timeout=1800)
            made[key] = python
        return made[key]

    return make


@pytest.fixture(scope="session")
def blender(environment) -> Callable[[str], Path]:
    """A function that returns a Python which is Blender of a version of ``BLENDERS``."""
    return lambda version: environment(BLENDER_PYTHON, f"bpy=={version}")


@pytest.fixture(scope="session", params=BLENDERS)
def every_blender(request, blender) -> Path:
    """A Python that is Blender, of each version."""
    return blender(request.param)
