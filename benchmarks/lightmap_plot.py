"""The curve of error over bytes of light maps."""

from __future__ import annotations

import json
import subprocess
import tempfile
from pathlib import Path

from lightmap_scenes import CURVE
from rows import Row

STYLE = """
body { margin: 0; background: #fff; font: 12px system-ui, sans-serif; } svg { width: 840px; }
text { fill: #444; font-size: 10px; }
.title { font-size: 11px; fill: #000; } .grid { stroke: #e4e4e4; } .axis { stroke: #999; }
.front { fill: none; stroke: #999; } .tone-0 { fill: #c8501e; } .tone-1 { fill: #3a6ea5; }
"""


def curve(plot: bool) -> list[Row]:
    """PSNR over bytes of what the scenes' parts have remembered."""
    if not plot or not CURVE.exists():
        return []
    from lightwell.report.charts import Axis
    from lightwell.report.scatter import Point, scatter_chart

    error = Axis("error of the screen, RMS (1 % is 40 dB)", lambda v: f"{v:.1%}", log=True)
    size = Axis("bytes", lambda v: f"{v / 1e3:g} k", log=True)
    marked = [
        Point(f"{name} {label}", p["bytes"], 10 ** (-p["dB"] / 20), "tone-0" if label == "default" else "tone-1")
        for name, labels in json.loads(CURVE.read_text()).items()
        for label, p in labels.items()
    ]
    chart_ = scatter_chart(marked, size, error, "Error of held-out views over bytes")
    folder = Path(tempfile.mkdtemp())
    (folder / "curve.html").write_text(
        f"<!doctype html><meta charset=utf-8><style>{STYLE}</style><main>{chart_}</main>"
    )
    path = Path(__file__).resolve().parents[1] / "docs" / "images" / "lightmap-curve.png"
    tool = Path(__file__).resolve().parents[1] / "tools" / "find-chromium.sh"
    browser = subprocess.run(["sh", tool], capture_output=True, text=True).stdout.strip() or "chromium"
    options = ["--headless", "--no-sandbox", "--hide-scrollbars", "--window-size=860,520", f"--screenshot={path}"]
    subprocess.run([browser, *options, str(folder / "curve.html")], check=True, capture_output=True, timeout=120)
    print(f"wrote {path}")
    return []
