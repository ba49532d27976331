"""Checks of the installation for ``lightwell doctor``: what works, and what to do about what does not."""

from __future__ import annotations

import importlib.metadata
import importlib.resources
import os
import platform
import shutil
import sys
from dataclasses import asdict, dataclass
from typing import Any

from lightwell.core.units import size_text
from lightwell.machine import available_processors, container_memory

# Free disk and memory below which a bake of a house may fail, bytes.
LEAST_DISK, LEAST_MEMORY = 2_000_000_000, 2_000_000_000


@dataclass(frozen=True)
class Check:
    """One line of ``lightwell doctor``."""

    name: str
    ok: bool
    found: str
    cure: str = ""
    """What to do when it is not ok, or how to gain more when it is."""


def version_of(package: str) -> str:
    """Look up the installed version of a distribution.

    Args:
        package: Name of the distribution, as pip knows it.

    Returns:
        The version, or "missing".
    """
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "missing"


def versions() -> dict[str, str]:
    """Collect the versions of all software that can change a numeric result.

    Returns:
        Package name → version or "missing"; ``python`` is the interpreter's.
    """
    packages = (
        "lightwell",
        "mitsuba",
        "drjit",
        "numpy",
        "karellen-llvm-core",
        "mitsuba-oidn",
        "scikit-image",
        "flip-evaluator",
    )
    return {"python": platform.python_version(), **{name: version_of(name) for name in packages}}


def machine() -> str:
    """Describe the machine in a few words.

    Returns:
        Operating system, architecture and number of cores, for example "Linux x86_64, 8 cores".
    """
    cores, used = os.cpu_count() or 1, available_processors()
    fewer = "" if used == cores else f", {used} of them for this process"
    return f"{platform.system()} {platform.machine()}, {cores} cores{fewer}"


def _backend_checks() -> list[Check]:
    try:
        from lightwell import backend
    except RuntimeError as error:
        return [Check("backend", False, str(error), "see above")]
    active = backend.ACTIVE
    where = f", LLVM {active.llvm}" if active.llvm else ""
    checks = [Check("backend", True, f"{active.variant}, {active.threads} threads{where}")]
    checks.append(_arithmetic(backend))
    if active.variant.startswith("llvm"):
        note = "a NVIDIA GPU with driver >= 535 is used by itself when there is one"
        checks.append(Check("gpu", True, "none in use", note))
    return checks


def _arithmetic(backend: Any) -> Check:
    """Compile and run one small kernel: an LLVM that loads may still be unable to generate code."""
    try:
        total = backend.dr.sum(backend.dr.square(backend.dr.arange(backend.mi.Float, 10)))
        ok = abs(float(total[0]) - 285.0) < 1e-3
        return Check(
            "kernel", ok, "a test kernel ran" if ok else f"a test kernel gave {total}, expected 285", backend.cure()
        )
    except Exception as error:  # any failure of the compiler is the finding itself
        return Check("kernel", False, f"a test kernel failed: {error}", backend.cure())


def _viewer_check() -> Check:
    page = importlib.resources.files("lightwell") / "viewer" / "index.html"
    if page.is_file():
        return Check("viewer", True, f"built page, {size_text(len(page.read_bytes()))}")
    return Check("viewer", False, "the built page is missing", "run 'make viewer' (needs Node >= 20) or reinstall")


def _denoiser_check() -> Check:
    from lightwell.core.denoise import missing

    cure = missing()
    return Check(
        "denoiser", not cure, "missing" if cure else f"Open Image Denoise {version_of('mitsuba-oidn')}", cure or ""
    )


def _disk_check() -> Check:
    free = shutil.disk_usage(".").free
    return Check(
        "disk",
        free > LEAST_DISK,
        f"{size_text(free)} free here",
        "a bake writes up to 3 GB of samples; free some space",
    )


def _memory_check() -> Check:
    limit = container_memory()
    ok = limit is None or limit > LEAST_MEMORY
    found = "no limit of a container" if limit is None else f"{size_text(limit)}, the limit of this container"
    return Check("memory", ok, found, "a bake takes up to 3 GB; give the container more, or bake smaller scenes")


def checks() -> list[Check]:
    """Run all checks of the installation.

    Returns:
        One result per check, the most important first.
    """
    python_ok = sys.version_info >= (3, 10)
    python = Check("python", python_ok, platform.python_version(), "lightwell needs Python >= 3.10")
    return [python, *_backend_checks(), _viewer_check(), _denoiser_check(), _memory_check(), _disk_check()]


def report() -> dict[str, Any]:
    """Collect the machine, versions and checks as JSON-serialisable data.

    Returns:
        A dictionary with keys ``machine`` (text), ``versions`` (name → version) and ``checks`` (list of the fields of
        ``Check``).
    """
    return {"machine": machine(), "versions": versions(), "checks": [asdict(check) for check in checks()]}
