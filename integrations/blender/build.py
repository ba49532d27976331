"""Builds the Blender extension: python integrations/blender/build.py [--platform linux-x64 …] -o dist

One zip a platform, with the wheels of lightwell and of all that it needs, listed in the manifest. Wheels come from the
index of pip; --no-wheels makes a small zip for those who name a Python with lightwell in the preferences.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import zipfile
from pathlib import Path

SOURCE = Path(__file__).parent / "lightwell_bake"
# Blender's names of platforms to pip's; Blender 4.2 to 5.0 have Python 3.11.
PLATFORMS = {
    "linux-x64": ("manylinux_2_28_x86_64", "manylinux_2_27_x86_64", "manylinux_2_17_x86_64", "manylinux2014_x86_64"),
    "macos-arm64": ("macosx_14_0_arm64", "macosx_11_0_arm64"),
    "windows-x64": ("win_amd64",),
}
PYTHON = "3.11"
# The time of every member, so that the same sources give the same file.
EPOCH = (2020, 1, 1, 0, 0, 0)


def manifest(wheels: list[str], platform: str) -> str:
    """Fill in the manifest.

    Args:
        wheels: File names of the wheels.
        platform: Blender's name of the platform; "" for all.

    Returns:
        Its text.
    """
    text = (SOURCE / "blender_manifest.toml").read_text("utf-8")
    lines = [f'platforms = ["{platform}"]'] if platform else []
    if wheels:
        lines += ["wheels = [", *(f'  "./wheels/{name}",' for name in sorted(wheels)), "]"]
    head, permissions = text.split("[permissions]")
    return head + "\n".join(lines) + ("\n\n" if lines else "") + "[permissions]" + permissions


def fetch_wheels(platform: str, wheel: str, folder: Path) -> list[Path]:
    """Download wheels with pip.

    Args:
        platform: A key of ``PLATFORMS``.
        wheel: What to install: a wheel of lightwell, or its name.
        folder: Folder to download to.

    Returns:
        Paths of the wheels.
    """
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--only-binary", ":all:", "--python-version", PYTHON]
    for name in PLATFORMS[platform]:
        command += ["--platform", name]
    subprocess.run([*command, "--dest", str(folder), wheel], check=True)
    return sorted(folder.glob("*.whl"))


def build(out: Path, platform: str = "", wheels: list[Path] | None = None) -> Path:
    """Write the zip of the extension.

    Args:
        out: Folder to write to.
        platform: Blender's name of the platform; "" for all.
        wheels: Wheels to put inside.

    Returns:
        Path of the zip.
    """
    found = wheels or []
    out.mkdir(parents=True, exist_ok=True)
    path = out / f"lightwell_bake{'-' + platform if platform else ''}.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for source in sorted(SOURCE.glob("*.py")):
            archive.writestr(zipfile.ZipInfo(source.name, EPOCH), source.read_bytes())
        text = manifest([wheel.name for wheel in found], platform)
        archive.writestr(zipfile.ZipInfo("blender_manifest.toml", EPOCH), text)
        for wheel in found:
            archive.writestr(zipfile.ZipInfo(f"wheels/{wheel.name}", EPOCH), wheel.read_bytes())
    return path


def main() -> None:
    """Build what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=Path, default=Path("dist"))
    parser.add_argument("--platform", action="append", choices=list(PLATFORMS), help="default: all")
    parser.add_argument("--wheel", default="lightwell", help="wheel of lightwell (default: that of the index)")
    parser.add_argument("--no-wheels", action="store_true")
    arguments = parser.parse_args()
    if arguments.no_wheels:
        print(build(arguments.out))
        return
    for platform in arguments.platform or list(PLATFORMS):
        folder = arguments.out / f"wheels-{platform}"
        folder.mkdir(parents=True, exist_ok=True)
        print(build(arguments.out, platform, fetch_wheels(platform, arguments.wheel, folder)))


if __name__ == "__main__":
    main()
