"""What a frame's blur took: the figures that the command line prints and the tests look at."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class Report:
    """Counts, extremes and seconds of one frame."""

    largest: float = 0.0
    """Largest circle of confusion, radius in pixels."""
    longest: float = 0.0
    """Longest motion while the shutter is open, pixels."""
    nodes: int = 0
    """Nodes of the library that were used."""
    points: float = 0.0
    """Writes per pixel and layer that has light."""
    dense: float = 0.0
    """What dense kernels would have written instead, per the same."""
    clamped: int = 0
    """Pixels whose blur was larger than allowed and cut."""
    bad: int = 0
    """Pixels with NaN or infinite colour or impossible depth or motion; they shine no light."""
    fine: int = 0
    """Pixels bright enough for the lossless tier."""
    layers: int = 1
    """Depth layers."""
    pixels: int = 0
    """Shining pixels of all layers."""
    guard: int = 0
    """Guard band, pixels."""
    notes: list[str] = field(default_factory=list)
    """What was assumed or left out, for the reader."""
    seconds: dict[str, float] = field(default_factory=dict)
    """Time by stage: plan, bake, splat, solve, composite."""

    def line(self) -> str:
        """One line for people."""
        share = f" ({100 * self.points / self.dense:.0f} % of dense)" if self.dense else ""
        text = (
            f"largest blur {self.largest:.1f} px, motion {self.longest:.1f} px, {self.layers} layers, "
            f"{self.nodes} nodes, {self.points:.0f} points a pixel{share}"
        )
        if self.clamped:
            text += f", {self.clamped} pixels clamped"
        if self.bad:
            text += f", {self.bad} pixels without usable colour or depth left out"
        return text + f", {sum(self.seconds.values()):.2f} s"
