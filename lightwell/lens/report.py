"""Statistics of blurring a frame, which the command line prints."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class Report:
    """Counts, extremes and run times of one frame."""

    largest: float = 0.0
    """Largest circle of confusion, radius in pixels."""
    longest: float = 0.0
    """Longest motion while the shutter is open, pixels."""
    nodes: int = 0
    """Nodes of the library that were used."""
    points: float = 0.0
    """Writes per pixel and layer that has light."""
    dense: float = 0.0
    """Writes per pixel and layer that dense kernels would need."""
    clamped: int = 0
    """Pixels whose blur was clamped to the largest radius or length."""
    bad: int = 0
    """Pixels with NaN or infinite colour or invalid depth or motion; replaced by their nearest valid neighbour."""
    fine: int = 0
    """Pixels bright enough for the lossless tier."""
    layers: int = 1
    """Depth layers."""
    pixels: int = 0
    """Pixels with light, of all layers."""
    guard: int = 0
    """Guard band, pixels."""
    seconds: dict[str, float] = field(default_factory=dict)
    """Time by stage: plan, bake, splat, solve, composite."""

    def line(self) -> str:
        """Format the report.

        Returns:
            One line of text.
        """
        share = f" ({100 * self.points / self.dense:.0f} % of dense)" if self.dense else ""
        text = (
            f"largest blur {self.largest:.1f} px, motion {self.longest:.1f} px, {self.layers} layers, "
            f"{self.nodes} nodes, {self.points:.0f} points a pixel{share}"
        )
        if self.clamped:
            text += f", {self.clamped} pixels clamped"
        if self.bad:
            text += f", {self.bad} pixels without usable colour or depth replaced"
        return text + f", {sum(self.seconds.values()):.2f} s"
