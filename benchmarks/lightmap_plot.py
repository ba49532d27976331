"""The curve of error over bytes of light maps: docs/images/lightmap-curve.png."""

from __future__ import annotations

import json
import subprocess
import tempfile
from html import escape
from pathlib import Path

from lightmap_scenes import CURVE
from rows import Row

ROOT = Path(__file__).resolve().parents[1]
# One colour for every scene; its light maps differ by their marks.
COLOURS = ("#c8501e", "#3a6ea5", "#4c8c4a", "#7d5ba6")
WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 860, 480, 60, 190, 56, 56
STYLE = """
body { margin: 0; background: #fff; font: 13px system-ui, sans-serif; } text { fill: #444; font-size: 13px; }
.grid { stroke: #e4e4e4; } .line { fill: none; stroke-width: 1.5; } .title { font-size: 15px; fill: #000; }
"""
# Distance that labels at the right keep from each other.
LABEL_GAP = 18


def curve(plot: bool) -> list[Row]:
    """PSNR over bytes of what the scenes' parts have remembered."""
    if not plot or not CURVE.exists():
        return []
    folder = Path(tempfile.mkdtemp())
    drawn = drawing(json.loads(CURVE.read_text()))
    (folder / "curve.html").write_text(f"<!doctype html><meta charset=utf-8><style>{STYLE}</style>{drawn}")
    path = ROOT / "docs" / "images" / "lightmap-curve.png"
    found = subprocess.run(["sh", ROOT / "tools" / "find-chromium.sh"], capture_output=True, text=True).stdout.strip()
    options = ["--headless", "--no-sandbox", "--hide-scrollbars", f"--window-size={WIDTH},{HEIGHT}"]
    command = [found or "chromium", *options, f"--screenshot={path}", str(folder / "curve.html")]
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    print(f"wrote {path}")
    return []


def drawing(scenes: dict[str, dict[str, dict[str, float]]]) -> str:
    """SVG: for every scene a line through its plain light maps, a square for the directional one, a disc for ours."""
    from lightwell.report.charts import ChartScale

    points = [p for labels in scenes.values() for p in labels.values()]
    low, high = (f(p["dB"] for p in points) for f in (min, max))
    x = ChartScale(*(f(p["bytes"] for p in points) * k for f, k in ((min, 0.8), (max, 1.2))), LEFT, WIDTH - RIGHT, True)
    y = ChartScale(low - 1, max(high, 40) + 1, HEIGHT - BOTTOM, TOP, False)
    parts = [*_grid(x, y)]
    names = []
    for (name, labels), colour in zip(scenes.items(), COLOURS):
        plain = sorted((p["bytes"], p["dB"]) for label, p in labels.items() if label.startswith("plain"))
        joined = " ".join(f"{x(b):.1f},{y(d):.1f}" for b, d in plain)
        parts.append(f'<polyline class="line" stroke="{colour}" points="{joined}"/>')
        parts += [f'<circle cx="{x(b):.1f}" cy="{y(d):.1f}" r="3" fill="{colour}"/>' for b, d in plain]
        if (p := labels.get("directional")) is not None:
            at = f'x="{x(p["bytes"]) - 5:.1f}" y="{y(p["dB"]) - 5:.1f}" width="10" height="10"'
            parts.append(f'<rect {at} fill="#fff" stroke="{colour}" stroke-width="2"/>')
        if (p := labels.get("default")) is not None:
            parts.append(f'<circle cx="{x(p["bytes"]):.1f}" cy="{y(p["dB"]):.1f}" r="8" fill="{colour}"/>')
            names.append((y(p["dB"]), x(p["bytes"]), name, colour))
    parts += _names(names)
    return f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{HEIGHT}">{"".join(parts)}</svg>'


def _grid(x, y) -> list[str]:
    """Lines of every 2 dB and of powers of ten, and what the marks mean."""
    parts = [
        '<text class="title" x="16" y="22">PSNR of held-out views over bytes, noise of the truth taken off</text>',
        f'<text x="{LEFT}" y="42">large disc: default · small discs: ordinary light map as WebP 50, 75, 90, lossless · '
        "square: directional light map</text>",
        f'<text x="{WIDTH - RIGHT}" y="{HEIGHT - 12}" text-anchor="end">bytes of textures and weights</text>',
    ]
    for value in range(int(y.low) + 1, int(y.high) + 1):
        if value % 2 == 0:
            parts.append(f'<path class="grid" d="M{LEFT} {y(value):.1f}H{WIDTH - RIGHT}"/>')
            parts.append(f'<text x="{LEFT - 8}" y="{y(value) + 4:.1f}" text-anchor="end">{value} dB</text>')
    for size in (m * 10**e for e in range(3, 8) for m in (1, 3)):
        if x.low <= size <= x.high:
            parts.append(f'<path class="grid" d="M{x(size):.1f} {TOP}V{HEIGHT - BOTTOM}"/>')
            label = f"{size // 1000} kB" if size < 1e6 else f"{size / 1e6:g} MB"
            parts.append(f'<text x="{x(size):.1f}" y="{HEIGHT - BOTTOM + 18}" text-anchor="middle">{label}</text>')
    return parts


def _names(names: list[tuple[float, float, str, str]]) -> list[str]:
    """Names of the scenes at the right, apart from each other, each joined with its disc."""
    parts, last = [], -LABEL_GAP
    for height, place, name, colour in sorted(names):
        last = max(height, last + LABEL_GAP)
        end = WIDTH - RIGHT + 10
        parts.append(
            f'<path class="line" stroke="{colour}" opacity=".4" d="M{place:.1f} {height:.1f}L{end} {last:.1f}"/>'
        )
        parts.append(f'<text x="{end + 5}" y="{last + 4:.1f}" style="fill:{colour}">{escape(name)}</text>')
    return parts
