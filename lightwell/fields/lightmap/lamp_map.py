"""The light of groups of lamps in a light map: R pictures, and what each lamp takes of each.

    E' = Σ_r w_r P_r,   w_rc = Σ_k d_kc A_krc,   d_kc what lamp k is multiplied by in channel c

The sum w is evaluated once a frame; a pixel reads R pictures, however many lamps there are. Notation: K lamps, R
pictures, M features of the network that view-dependent light is made of.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lightwell.fields.lightmap.curve import restored_node
from lightwell.fields.surface.lamps import state_matrix
from lightwell.graph import Builder
from lightwell.graph.pictures import Picture
from lightwell.networks.lightmap_lamps import LampRows

# Name of the buffer of A, which is never rounded: all lamps at once are the light of the scene.
LAMP_WEIGHTS = "lamp_weights"
# Features of view-dependent light: for each lamp, and at most.
FEATURES, MOST_FEATURES = 3, 24


@dataclass(frozen=True)
class LampMap:
    """The light of K lamps in R pictures."""

    names: tuple[str, ...]
    """Names of the K groups."""
    pictures: tuple[Picture, ...]
    """R pictures P, stored with the curve of the light map, each in a unit of its own."""
    weights: np.ndarray
    """[K, R, 3] A ≥ 0: E' / S of a lamp for the numbers of each picture."""
    units: np.ndarray
    """[K] mean light of each lamp alone, relative to that of all."""
    errors: tuple[float, ...] = ()
    """Mean relative error of each lamp that the number of pictures leaves."""

    @property
    def count(self) -> int:
        """K."""
        return len(self.names)

    @property
    def rank(self) -> int:
        """R."""
        return len(self.pictures)

    @property
    def features(self) -> int:
        """M."""
        return min(FEATURES * self.count, MOST_FEATURES)

    @property
    def stored(self) -> dict[str, Picture]:
        """Name of the buffer of each picture."""
        return {f"e{r}": picture for r, picture in enumerate(self.pictures)}

    def parts(self, b: Builder, buffer: Callable[[Picture, str], str]) -> list[str]:
        """Add what each picture holds, decoded.

        Args:
            b: Graph to add nodes to.
            buffer: Adds a picture as a buffer of a name; returns that.

        Returns:
            Names of R nodes, width 3 each.
        """
        read = [b.texture("uv1", buffer(picture, name)) for name, picture in self.stored.items()]
        return [restored_node(b, q) for q in read]

    def light(self, b: Builder, buffer: Callable[[Picture, str], str]) -> str:
        """Add E' / S of the lamps as they are set, by the graph's input ``lamps``.

        Args:
            b: Graph to add nodes to.
            buffer: Adds a picture as a buffer of a name; returns that.

        Returns:
            Name of the node, width 3.
        """
        matrix = np.zeros((self.rank, 3, 3, self.count), np.float32)
        for c in range(3):
            matrix[:, c, c] = self.weights[:, :, c].T
        size = 3 * self.rank
        table = b.buffer(matrix.reshape(size, 3 * self.count), LAMP_WEIGHTS)
        taken = b.linear("lamps", table, np.zeros(size), per_frame=True)
        shares = [
            b.multiply(part, b.slice(taken, 3 * r, 3, per_frame=True)) for r, part in enumerate(self.parts(b, buffer))
        ]
        total = shares[0]
        for share in shares[1:]:
            total = b.add(total, share)
        return total

    def gloss(self, b: Builder, e: str, layers: np.ndarray) -> str:
        """Add view-dependent light of the lamps as they are set, relative to the reflectance, in unit S.

        Args:
            b: Graph to add nodes to.
            e: Name of the node of the network's outputs: three factors of the diffuse light, then M features.
            layers: [M, 3 K] numbers of each lamp, whose squares weigh the features.

        Returns:
            Name of the node, width 3.
        """
        count, width = self.count, self.features
        dimmers = b.affine("lamps", np.tile(self.units, 3), np.zeros(3 * count), per_frame=True)
        squares, none = np.square(layers).reshape(width, count, 3), np.zeros(width)
        merged = [
            b.linear(b.slice(dimmers, c * count, count, per_frame=True), squares[..., c], none, per_frame=True)
            for c in range(3)
        ]
        return b.matvec(b.concat(*merged, per_frame=True), b.slice(e, 3, width), 3)

    # ------------------------------------------------------------------ training

    def state_units(self, states: np.ndarray) -> np.ndarray:
        """Compute the unit of each state of the dimmers, relative to S.

        Args:
            states: [states, K] factors.

        Returns:
            [states] units.
        """
        return np.asarray(states @ self.units)

    def mixing(self, states: np.ndarray) -> np.ndarray:
        """Compute the matrix from pictures to the diffuse light of states.

        Args:
            states: [states, K] factors.

        Returns:
            [3 R, 3 states], in units of the states.
        """
        taken = np.einsum("sk,krc->src", states, self.weights) / self.state_units(states)[:, None, None]
        matrix = np.zeros((self.rank, 3, len(states), 3))
        for c in range(3):
            matrix[:, c, :, c] = taken[..., c].T
        return matrix.reshape(3 * self.rank, 3 * len(states))


def lamp_rows(
    lamps: LampMap,
    whole: np.ndarray,
    shares: np.ndarray | None,
    weight: np.ndarray,
    seed: int,
    rows: np.ndarray,
) -> LampRows:
    """Make the training rows of a network whose lamps have switches.

    Args:
        lamps: K lamps.
        whole: [N, 3] light of all lamps, in unit S.
        shares: [N, K, 3] light of each lamp, in unit S.
        weight: [N] importance weights.
        seed: Seed of the random states.
        rows: [N, F] inputs of the network.

    Returns:
        The rows on the device.

    Raises:
        ValueError: There are no shares.
    """
    if shares is None:
        raise ValueError("train: lamps that have switches need the light of each; give ``shares``")
    states = state_matrix(lamps.count, seed)
    target = np.concatenate([shares / lamps.units[:, None], whole[:, None]], axis=1)
    return LampRows.from_numpy(rows, target, weight, states, lamps.units, lamps.mixing(states))
