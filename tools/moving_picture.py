"""Moving pictures of README and docs: the light of a baked page changes, direct light beside learned light.

    python tools/moving_picture.py demo docs/images/lamp.webp
    python tools/moving_picture.py out/door docs/images/door.webp --query "movers=Door:{}" --range 90,0 --back
    python tools/moving_picture.py out/day docs/images/day.webp --query "day={}" --range 5,21
    python tools/moving_picture.py out/loft docs/images/lamps.webp --lamps --intensity 0 --learned
    python tools/moving_picture.py out/loft two.webp --queries "lamps=desk:1 lamps=desk:0" --learned

Reads FOLDER/index.html and FOLDER/scene.glb, as `make demo` writes them. Needs Node and a Chromium. The pictures of the
documentation, with the bakes that they are of:

    lightwell bake courtyard-day -o out/day
    python tools/moving_picture.py out/day docs/images/day.webp --query "day={}" --range 6,19 --frames 27 --most 400
    lightwell bake loft -o out/loft --lamps name
    python tools/moving_picture.py out/loft docs/images/lamps.webp --lamps --intensity 0 --exposure 2 --learned \\
        --frames 44 --milliseconds 160 --most 400
    lightwell bake doorway -o out/door --vary "node:Door.rotation=y:0..90"
    python tools/moving_picture.py out/door docs/images/door.webp --query "movers=Door:{}" --range 90,0 --back \\
        --learned --frames 36 --milliseconds 110 --most 400
"""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
from pathlib import Path
from urllib.parse import quote

import numpy as np
from PIL import Image, ImageDraw, ImageFont

import lightwell
from lightwell.asset.info import info

ROOT = Path(__file__).parents[1]
# Largest file, kilobytes: what a README may ask a reader to load.
MOST_KILOBYTES = 3_000
# Encoder qualities that are tried, best first.
QUALITIES = (82, 74, 66, 58, 50, 42)
LABELS = ("direct light only", "with learned light")
BAR = 4


def lamp_path(low: np.ndarray, high: np.ndarray, frames: int, share: float) -> np.ndarray:
    """Lay a closed path through the box of the lamp.

    Args:
        low: [3] lower corner, metres.
        high: [3] upper corner.
        frames: Number of places.
        share: Share of the box that the path spans.

    Returns:
        [frames, 3] places.
    """
    angle = np.linspace(0, 2 * np.pi, frames, endpoint=False)
    swing = np.stack([np.cos(angle), np.sin(2 * angle) * 0.7, np.sin(angle)], -1)
    return (low + high) / 2 + share * (high - low) / 2 * swing


def photograph(folder: Path, plan: dict) -> np.ndarray:
    """Draw the frames in a browser.

    Args:
        folder: Baked folder.
        plan: What tools/moving-picture.mjs reads.

    Returns:
        [frames, 2, height, width, 3] uint8: direct and learned light.
    """
    width, height = plan["size"]
    with tempfile.TemporaryDirectory() as scratch:
        asked, drawn = Path(scratch) / "plan.json", Path(scratch) / "frames.bin"
        asked.write_text(json.dumps(plan))
        script = [
            str(ROOT / "tools/moving-picture.mjs"),
            str((folder / "index.html").resolve()),
            str(asked),
            str(drawn),
        ]
        subprocess.run(["node", *script], check=True)
        pixels = np.fromfile(drawn, np.uint8)
    return pixels.reshape(len(plan.get("queries") or plan["lamps"]), 2, height, width, 4)[..., :3]


def queries_of(given: argparse.Namespace) -> list[str] | None:
    """List the states of the page, one a frame; None where its lamp goes around.

    Args:
        given: Options.

    Returns:
        Queries of the page's address.
    """
    if given.lamps:
        return lamp_queries(info(given.folder / "scene.glb")["lamps"], given.frames)
    if given.queries:
        words = given.queries.split()
        return [word for word in words for _ in range(max(given.frames // len(words), 1))]
    if not given.query:
        return None
    low, high = (float(number) for number in given.range.split(","))
    share = np.linspace(0, 1, given.frames)
    share = 0.5 - 0.5 * np.cos(2 * np.pi * share) if given.back else share
    values = low + (high - low) * share
    text = [f"{int(v)}:{int(v % 1 * 60):02d}" if given.query.startswith("day=") else f"{v:.4g}" for v in values]
    return [given.query.replace("{}", value) for value in text]


def lamp_queries(names: list[str], frames: int) -> list[str]:
    """Show all lamps, then switch them on from darkness, one after the other; each grows bright in half of its time.

    Args:
        names: The lamps.
        frames: Number of frames. The first one is what a reader without motion sees.

    Returns:
        Queries of the page's address.
    """
    found = []
    for frame in range(frames):
        at = (len(names) + 1) * frame / frames
        dimmers = np.clip(2 * (at - 1 - np.arange(len(names))), 0, 1) if at >= 1 else np.ones(len(names))
        found.append("lamps=" + ";".join(f"{quote(name)}:{dimmer:.3g}" for name, dimmer in zip(names, dimmers)))
    return found


def side_by_side(pair: np.ndarray, learned: bool) -> Image.Image:
    """Join two pictures and write below what each is.

    Args:
        pair: [2, height, width, 3] uint8.
        learned: Show the one with learned light alone.

    Returns:
        The picture.
    """
    if learned:
        return Image.fromarray(np.ascontiguousarray(pair[1]))
    _, height, width, _ = pair.shape
    whole = np.full((height, 2 * width + BAR, 3), 255, np.uint8)
    whole[:, :width], whole[:, width + BAR :] = pair
    image = Image.fromarray(whole)
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(size=max(12, height // 18))
    for label, left in zip(LABELS, (0, width + BAR)):
        place = (left + height // 30, height - height // 30)
        draw.text(place, label, "white", font, anchor="ls", stroke_width=2, stroke_fill="black")
    return image


def write(path: Path, images: list[Image.Image], milliseconds: int, most: int) -> int:
    """Write an animated WebP of at most so many bytes.

    Args:
        path: File to write.
        images: Its frames.
        milliseconds: Duration of a frame.
        most: Bytes.

    Returns:
        Quality of the encoder.

    Raises:
        ValueError: Even the lowest quality is too large.
    """
    for quality in QUALITIES:
        images[0].save(
            path,
            "WEBP",
            save_all=True,
            append_images=images[1:],
            duration=milliseconds,
            loop=0,
            quality=quality,
            method=4,
        )
        if path.stat().st_size <= most:
            return quality
    raise ValueError(f"{path}: over {most:,} bytes at quality {QUALITIES[-1]}; take fewer or smaller frames")


def main() -> None:
    """Make the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="folder that `make demo` wrote")
    parser.add_argument("out", type=Path, help="animated .webp to write")
    parser.add_argument("--size", default="440x300", help="pixels of each half")
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--view", type=int, default=0, help="saved view of the page")
    parser.add_argument("--camera", help="instead of a view: x,y,z/x,y,z/degrees (eye, target, vertical field of view)")
    parser.add_argument("--intensity", type=float, help="candela of the lamp; that of the page by default")
    parser.add_argument("--exposure", type=float, help="fixed exposure; that of the page by default")
    parser.add_argument("--share", type=float, default=0.8, help="share of its box in which the lamp goes around")
    parser.add_argument("--milliseconds", type=int, default=80, help="duration of a frame")
    parser.add_argument("--query", help="state of the page with {} for a value of --range, such as 'movers=Door:{}'")
    parser.add_argument("--range", default="0,1", help="first and last value of --query; hours where it is a day")
    parser.add_argument("--back", action="store_true", help="go back to the first value of --range")
    parser.add_argument("--queries", help="states of the page, separated by spaces")
    parser.add_argument("--lamps", action="store_true", help="switch the lamps of the bake on, one after the other")
    parser.add_argument("--most", type=int, default=MOST_KILOBYTES, help="largest file, kilobytes (1,000 bytes)")
    parser.add_argument("--learned", action="store_true", help="learned light alone")
    given = parser.parse_args()
    plan = {"size": [int(n) for n in given.size.split("x")], "view": given.view}
    queries = queries_of(given)
    if queries is None:
        variable = lightwell.read(given.folder / "scene.glb").variables[0]
        lamps = lamp_path(np.array(variable["low"]), np.array(variable["high"]), given.frames, given.share)
        plan["lamps"] = lamps.tolist()
    else:
        plan["queries"] = queries
    if given.camera:
        eye, target, angle = given.camera.split("/")
        plan["camera"] = [[float(v) for v in eye.split(",")], [float(v) for v in target.split(",")], float(angle)]
    plan |= {name: value for name in ("intensity", "exposure") if (value := getattr(given, name)) is not None}
    frames = photograph(given.folder, plan)
    images = [side_by_side(pair, given.learned) for pair in frames]
    quality = write(given.out, images, given.milliseconds, 1000 * given.most)
    print(f"{given.out}: {len(images)} frames of {images[0].width}x{images[0].height}, quality {quality}, ", end="")
    print(f"{given.out.stat().st_size:,} bytes")


if __name__ == "__main__":
    main()
