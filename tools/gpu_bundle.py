"""Pack what benchmarks/gpu.py needs on a GPU machine that has Python and a driver and no network: one file.

    python tools/gpu_bundle.py -o out/gpu-bundle.tar.xz --python 3.12 --present scipy,scikit-image,pillow,…

On that machine:

    mkdir lightwell && tar -xJf gpu-bundle.tar.xz -C lightwell && cd lightwell && sh run.sh

Wheels of the wanted Python are downloaded by pip in the versions of this environment, unpacked, and stripped: of
Mitsuba only the CUDA variant and the plug-ins that lightwell and its tests name stay, of all packages no tests, headers
and type stubs. Packages that the machine has (``--present``, as ``pip list`` spells them) are left out. The shader
programs are printed here, because that machine need not have Node. The size of each part is printed, and a bundle of
more than ``--most`` MiB is an error.
"""

from __future__ import annotations

import argparse
import fnmatch
import lzma
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MOST_MIB = 45.0
# What the benchmark imports, with what that imports; names as on the package index.
PACKAGES = (
    "mitsuba", "drjit", "numpy", "scipy", "scikit-learn", "joblib", "pillow", "rich", "markdown-it-py", "mdurl",
    "pygments", "filelock", "jinja2", "markupsafe", "jsonschema", "jsonschema-specifications", "referencing", "rpds-py",
    "attrs", "typing-extensions", "threadpoolctl", "waitress", "xatlas", "shtab", "astral", "DracoPy", "meshopt",
    "scikit-image", "lazy-loader", "flip-evaluator", "OpenEXR", "wgpu", "cffi", "pycparser", "pytest", "iniconfig",
    "pluggy", "packaging",
)  # fmt: skip
# Dependencies that stay out: LLVM serves the processor, and the denoiser's weights alone have 45 MiB. Bakes on that
# machine say that it is missing; pictures of the reference keep their noise, errors are the same.
OMITTED = ("karellen-llvm-core", "mitsuba-oidn", "tomli")
# Platforms of wheels, newest first: pip matches each name exactly.
PLATFORMS = (
    *(f"manylinux_2_{minor}_x86_64" for minor in (39, 35, 34, 31, 28, 27, 24, 17)),
    *("manylinux2014_x86_64", "manylinux2010_x86_64", "manylinux1_x86_64"),
)
# Files of wheels that nothing at run time reads.
DROPPED = (
    "*/tests/*", "*/test/*", "*.pyi", "*.h", "*.hpp", "*.a", "*.lib", "*.pxd", "*.pyx", "*/__pycache__/*", "*/RECORD",
    "*.dist-info/licenses/*", "mitsuba/cmake/*", "drjit/cmake/*", "mitsuba/include/*", "drjit/include/*", "bin/*",
    "mitsuba/mitsuba", "mitsuba/mitsuba_stubs/*", "numpy/f2py/*",
    # Tables of spectral variants.
    "mitsuba/data/ior/*", "mitsuba/data/srgb.coeff",
    "scipy/datasets/*", "skimage/data/*",
)  # fmt: skip
# Headers that are read at run time.
KEPT = ("wgpu/resources/combined_header.h", "wgpu/resources/webgpu.h", "wgpu/resources/wgpu.h")
# Variants of Mitsuba that stay: the one that is measured, and the scalar one that it reads files with.
VARIANTS = ("cuda_ad_rgb", "scalar_rgb")
# Plug-ins that no scene of lightwell and none of its tests on a GPU names.
PLUGINS_DROPPED = (
    "ellipsoids*", "volpath*", "bsplinecurve", "linearcurve", "sdfgrid", "timed_sunsky", "measured*",
    "ptracer", "stokes", "hair", "pplastic", "polarizer", "retarder", "circular", "catmullrom", "lanczos", "mitchell",
    "tabphase", "sggx", "blendphase", "rayleigh", "heterogeneous", "gridvolume", "specfilm", "batch", "irregular",
    "blackbody", "d65", "distant", "radiancemeter", "irradiancemeter", "moment",
)  # fmt: skip
REPOSITORY = ("lightwell", "benchmarks", "tests", "tools", "format", "pyproject.toml", "README.md", "LICENSE")
REPOSITORY_DROPPED = ("lightwell/viewer/probes.html", "benchmarks/results/*", "tests/fuzz/*", "tests/compatibility/*")
RUN = """#!/bin/sh
# All stages that fit into the given minutes; call again to go on. Results: benchmarks/results/gpu.json
cd "$(dirname "$0")" && PYTHONPATH="$PWD/site:$PWD" exec "${PYTHON:-python3}" benchmarks/gpu.py "$@"
"""


def wheels(folder: Path, python: str, present: Iterable[str]) -> list[Path]:
    """Download the wheels of all packages that the machine lacks.

    Args:
        folder: Where to put them.
        python: Version of the machine's Python, for example '3.12'.
        present: Names of packages that it has.

    Returns:
        Paths of the wheels.

    Raises:
        RuntimeError: A package has no wheel for that Python.
    """
    there = {_plain(name) for name in present}
    wanted = [f"{name}=={version(name)}" for name in PACKAGES if _plain(name) not in there]
    command = [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "--only-binary=:all:", "-d", str(folder)]
    command += ["--python-version", python, "--implementation", "cp"]
    for platform in PLATFORMS:
        command += ["--platform", platform]
    done = subprocess.run([*command, *wanted], capture_output=True, text=True)
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if line.startswith("ERROR")]
        raise RuntimeError(f"gpu_bundle: pip download failed: {(lines or ['it said nothing'])[-1]}")
    return sorted(folder.glob("*.whl"))


def _plain(name: str) -> str:
    """A name as package indexes compare it."""
    return re.sub(r"[-_.]+", "-", name.strip()).lower()


def is_kept(name: str) -> bool:
    """Decide whether a file of a wheel is needed.

    Args:
        name: Path inside the wheel.

    Returns:
        True for a file that stays.
    """
    if name not in KEPT and any(fnmatch.fnmatchcase(name, pattern) for pattern in DROPPED):
        return False
    folder, _, file = name.rpartition("/")
    stem = file.split(".")[0]
    if folder == "mitsuba/plugins":
        return not any(fnmatch.fnmatchcase(stem, pattern) for pattern in PLUGINS_DROPPED)
    if folder == "mitsuba" and re.match(r"(cuda|llvm|scalar)_", stem):
        return stem in VARIANTS
    return True


def unpack(wheel: Path, site: Path) -> None:
    """Unpack the files of a wheel that are needed; libraries of Mitsuba and Dr.Jit lose their symbol tables.

    Args:
        wheel: A wheel.
        site: Folder to unpack to.
    """
    with tempfile.TemporaryDirectory() as folder:
        shutil.unpack_archive(wheel, folder, "zip")
        for path in sorted(Path(folder).rglob("*")):
            name = path.relative_to(folder).as_posix()
            if path.is_file() and is_kept(name):
                # Wheels put what belongs beside the package into NAME.data/purelib or platlib.
                to = site / re.sub(r"^[^/]+\.data/(purelib|platlib|data)/", "", name)
                to.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(path, to)
                if name.startswith(("mitsuba/", "drjit/")) and ".so" in to.suffixes and shutil.which("strip"):
                    subprocess.run(["strip", "--strip-unneeded", str(to)], check=True)


def repository(to: Path) -> None:
    """Copy the tracked files that the benchmark and its tests read.

    Args:
        to: Folder of the bundle.
    """
    command = ["git", "-C", str(ROOT), "ls-files", "-z", "--cached", "--others", "--exclude-standard", *REPOSITORY]
    for name in filter(None, subprocess.run(command, capture_output=True, text=True, check=True).stdout.split("\0")):
        if not any(fnmatch.fnmatchcase(name, pattern) for pattern in REPOSITORY_DROPPED) and (ROOT / name).is_file():
            (to / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, to / name)


def pack(folder: Path, out: Path) -> None:
    """Write a folder as .tar.xz.

    Args:
        folder: Folder to pack.
        out: File to write; it replaces an old one when it is whole.
    """
    part = out.with_name(f"{out.name}.part")
    with lzma.open(part, "wb", preset=9) as compressed, tarfile.open(fileobj=compressed, mode="w") as archive:
        for path in sorted(folder.rglob("*")):
            if path.is_file():
                archive.add(path, path.relative_to(folder).as_posix())
    part.replace(out)


def sizes(folder: Path) -> str:
    """Describe the largest parts of a folder, not compressed.

    Args:
        folder: The bundle's folder.

    Returns:
        Names with MiB.
    """
    parts = [*(folder / "site").iterdir(), *(p for p in folder.iterdir() if p.name != "site")]
    found = {p.name: sum(f.stat().st_size for f in [p, *p.rglob("*")] if f.is_file()) / 2**20 for p in parts}
    largest = sorted(found.items(), key=lambda item: -item[1])[:12]
    return ", ".join(f"{name} {mib:.1f}" for name, mib in largest)


def main() -> int:
    """Make the bundle.

    Returns:
        Exit code: 1 where the bundle is too large.
    """
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "out/gpu-bundle.tar.xz")
    parser.add_argument("--python", default=f"{sys.version_info.major}.{sys.version_info.minor}")
    parser.add_argument("--present", default="", help="packages that the machine has, separated by commas")
    parser.add_argument("--most", type=float, default=MOST_MIB, help="largest size, MiB (default: %(default)g)")
    parser.add_argument("--without-programs", action="store_true", help="the machine has Node and the web's packages")
    arguments = parser.parse_args()
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as temporary:
        folder, store = Path(temporary) / "bundle", Path(temporary) / "wheels"
        (folder / "site").mkdir(parents=True)
        for wheel in wheels(store, arguments.python, arguments.present.split(",")):
            unpack(wheel, folder / "site")
        repository(folder)
        if not arguments.without_programs:
            prepare = [sys.executable, str(ROOT / "benchmarks/gpu.py"), "--prepare", str(folder / "out/gpu-programs")]
            subprocess.run(prepare, check=True)
        (folder / "run.sh").write_text(RUN)
        pack(folder, arguments.out)
        print(f"not compressed, MiB: {sizes(folder)}")
    mib = arguments.out.stat().st_size / 2**20
    print(f"{arguments.out}: {mib:.1f} MiB of at most {arguments.most:g}")
    return 0 if mib <= arguments.most else 1


if __name__ == "__main__":
    sys.exit(main())
