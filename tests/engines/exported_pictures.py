"""Pictures of exported light maps in real engines of the browser, beside that of lightwell's own runtime."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from lightwell.asset.read import read_fields
from lightwell.asset.write import write_glb
from lightwell.engines.light_map import without_gloss
from lightwell.scenes import load

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Frame:
    """What all engines draw."""

    position: tuple[float, float, float]
    target: tuple[float, float, float]
    size: tuple[int, int] = (160, 120)
    fov: float = 45.0
    near: float = 0.05
    far: float = 50.0


def pictures(glb: Path, engines: Mapping[str, Path], frame: Frame, folder: Path) -> dict[str, np.ndarray]:
    """Draw a file with the light maps that were exported of it.

    Args:
        glb: The file.
        engines: Exported folders by engine: threejs, babylon, playcanvas.
        frame: The camera.
        folder: Where the pictures are written.

    Returns:
        [H, W, 3] bytes by engine; ``page`` is lightwell's own runtime.

    Raises:
        RuntimeError: A page had an error.
    """
    job = {
        "frame": asdict(frame),
        "glb": str(glb),
        "engines": {k: str(v) for k, v in engines.items()},
        "out": str(folder),
    }
    (folder / "job.json").write_text(json.dumps(job))
    command = ["node", str(ROOT / "tools/exported-light-maps.mjs"), str(folder / "job.json")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    if done.returncode or any(json.loads(done.stdout).values()):
        raise RuntimeError((done.stdout + done.stderr)[-2000:])
    width, height = frame.size
    read = lambda name: np.fromfile(folder / f"{name}.rgb", np.uint8).reshape(height, width, 3)[::-1]  # noqa: E731
    return {name: read(name) for name in ("page", *engines)}


def write_diffuse(path: Path, to: Path) -> None:
    """Write a file whose fields have no view-dependent light: exports hold the diffuse light alone.

    Args:
        path: A file with light maps.
        to: The file to write.
    """
    entries, variables = read_fields(path)
    plain = [replace(entry, graph=without_gloss(entry.graph)) for entry in entries]
    write_glb(to, load(path), plain, variables)


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    """Decibels of two pictures of bytes."""
    mse = float(np.mean((a / 255.0 - b / 255.0) ** 2))
    return -10 * np.log10(max(mse, 1e-12))
