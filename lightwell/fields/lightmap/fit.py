"""The fit of a neural light map: the light of surfaces in small textures, and a network that adds the view-dependent
part.

Fit to samples of radiance, with quantisation simulated in training, and lowered to a shading graph whose uint8 buffers
are stored as pictures. Notation: N samples, n texels along the edge of the atlas, S the unit of radiance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import numpy as np

from lightwell.backend import dr, mi
from lightwell.basisu import codec as basisu
from lightwell.core.formats import ARRAYS
from lightwell.core.work import WorkPart
from lightwell.fields.base import FieldSetup
from lightwell.fields.lightmap.atlas_images import push_pull
from lightwell.fields.lightmap.lamp_map import LampMap, lamp_rows
from lightwell.fields.lightmap.nodes import MapNodes, row_graph
from lightwell.fields.lightmap.stored_features import codec_error, feature_pictures, read_back
from lightwell.fields.protocol import GoodEnough
from lightwell.fields.tabulate import Tabulated
from lightwell.files import Arrays, prefixed, under
from lightwell.graph import Graph
from lightwell.graph.pictures import Picture
from lightwell.networks.atlas_texture import AtlasTexture
from lightwell.networks.device import tensor
from lightwell.networks.hashgrid import PACKET
from lightwell.networks.lightmap import BASE, FEATURE_HIGH, FEATURE_LOW, GAIN, GLOSS, HEAD, PLACE, LightmapNetwork
from lightwell.networks.lightmap_lamps import LampLightmapNetwork
from lightwell.networks.training import Trainer, TrainingSet, TrainingSettings
from lightwell.transport.lightmap_query import LightmapQuery

# Shares of the steps after which quantisation noise becomes rounding, and textures become those of the file.
ROUND_FROM, FREEZE_FROM = 0.5, 0.85
# The first two forms of the quantiser where sine layers compute the features: none, and rounding of their outputs.
PLACES = ("places", "rounded-places")
# How often features are encoded and decoded while they change, where the codec of the file is one of blocks.
CODEC_ROUNDS = 3
# Columns of a row.
COLUMNS = ("place", "base", "gain", "gloss", "mirror", "inputs", "about", "parts")
# Rows of which features are made at a time.
CHUNK = 1 << 16
# Share of the steps that read the textures at a random level of their mip chain.
FAR_SHARE = 0.25


@dataclass(frozen=True)
class LightmapPreset:
    """Settings of a light map."""

    base: str = "webp90"
    """Codec of the ordinary light map below the network; empty: none."""
    base_reduction: int = 1
    """Edge of the atlas relative to that of the stored picture."""
    direction_reduction: int = 4
    """The same for the picture of directions."""
    direction: bool = False
    """A second picture with the dominant direction (directional light map)."""
    channels: int = 6
    """Feature channels, three in a picture; 0: no features."""
    share: float = 0.25
    """Edge of the feature textures relative to that of the atlas."""
    hidden: tuple[int, ...] = (24, 24)
    """Widths of the network's layers; empty: no network."""
    activation: str = "relu"
    inputs: Literal["reflected", "mirror", "view", "report", "uv", "light"] = "reflected"
    """Inputs of the network other than the features; see ``MapNodes.inputs``."""
    siren: bool = False
    stage: tuple[int, ...] = ()
    """Sine layers that compute the features in training (siren-two-stage)."""
    surface: tuple[int, ...] = ()
    """Widths of the layers that compute the features from position and normal in training; empty: every texel is a
    parameter."""
    octaves: int = 4
    """Octaves of the frequency encoding of positions for these layers."""
    demodulated: bool = True
    """Without a base: whether the output is multiplied by the reflectance."""
    mirrors: tuple[int, ...] = ()
    """Edges of the textures of the environment, which the mirrored ray reads; coarse to fine."""
    mirror_channels: int = 6
    """Channels of each of these textures, a multiple of three."""
    codec: str = "webp"
    """Codec of the pictures above the ordinary light map: features, directions and mask."""
    storage: str = "float16"
    """Storage type of the weights; 'int8': with a step for every output row, biases as half floats."""
    rate: float = 5e-3
    size: int = 1024
    """Edge of the atlas unless another is asked for."""

    @property
    def stores_blocks(self) -> bool:
        """Whether features are stored as blocks, whose error training has to see."""
        return self.codec in basisu.CODECS and bool(self.channels) and not self.stage

    @property
    def stores_direction(self) -> bool:
        """Whether viewers read the directions; features that sine layers compute depend on them already."""
        return self.direction and (not self.hidden or self.inputs == "reflected")


DEFAULT = LightmapPreset(direction=True, channels=9, hidden=(24, 24), inputs="mirror", surface=(64, 64))

PRESETS: dict[str, LightmapPreset] = {
    "default": DEFAULT,
    "report": LightmapPreset(
        "", channels=8, share=1.0, hidden=(32, 32, 32), activation="sine", inputs="report", rate=2e-3, size=4096
    ),
    "report-relu": LightmapPreset(
        "", channels=8, share=1.0, hidden=(32, 32, 32), inputs="report", rate=2e-3, size=4096
    ),
    "siren": LightmapPreset("", channels=0, hidden=(32,) * 8, inputs="uv", siren=True, rate=1e-3),
    "siren-two-stage": LightmapPreset(
        "", channels=8, share=0.5, hidden=(16, 16), activation="sine", stage=(64,) * 4, rate=1e-3
    ),
    "default-int8": replace(DEFAULT, storage="int8"),
    "plain": LightmapPreset(channels=0, hidden=()),
    "directional": LightmapPreset(channels=0, hidden=(), direction=True),
    # Of --quality draft and best.
    "draft": replace(DEFAULT, size=512),
    "best": replace(DEFAULT, size=2048),
}

# The light map of a variable light: irradiance cannot be stored, only features for a network with the light as input.
MOVING = LightmapPreset("", channels=9, share=1 / 16, hidden=(32, 32), activation="silu", inputs="light")


@dataclass
class LightmapFit:
    """A light map while it is fitted."""

    preset: LightmapPreset
    size: int
    """n, texels along the edge of the atlas."""
    unit: float
    """S, radiance unit."""
    base: Picture | None = None
    """Irradiance / π, stored with an sRGB-like transfer function."""
    direction: Picture | None = None
    seed: int = 0
    batch: int = 1 << 14
    mips: int = 0
    """Levels of the atlas."""
    setup: FieldSetup | None = None
    """Of the scene; needed for a variable light and for an environment."""
    mask: Picture | None = None
    """Mask of the surfaces; see ``MapNodes``."""
    relief: bool = False
    """Whether normal maps bend the normals of a surface that is lit."""
    far_share: float = FAR_SHARE
    """Share of the steps that read the textures at a random level of their mip chain."""
    lamps: LampMap | None = None
    """Light of groups of lamps; None: it cannot be changed."""

    def __post_init__(self) -> None:
        extra: dict[str, Any] = {"size": self.size, "relief": self.relief, "lamps": self.lamps}
        self.nodes = MapNodes(self.preset, self.unit, self.base, self.direction, self.setup, self.mask, **extra)
        self.features: dict[str, Picture] = {}
        self.parameters: dict[str, np.ndarray] = {}
        self.history: list[tuple[int, float]] = []
        if self.preset.hidden:
            self._rows = Tabulated(row_graph(self.nodes))
            self.network = self._make_network(PLACES[0] if self.nodes.learns_places else "noise")
            self.parameters = self.network.initial(self.seed)

    def _make_network(self, quantiser: Any) -> LightmapNetwork:
        p, edge = self.preset, max(round(self.size * self.preset.share), 4)
        packed = -(-p.channels // PACKET) * PACKET
        surface = p.surface if quantiser in PLACES else ()
        texture = AtlasTexture(edge, edge, packed, quantiser) if p.channels and not surface else None
        width = self._rows.width("inputs")
        wide = -(-p.mirror_channels // PACKET) * PACKET
        stored = dict(zip(PLACES, ("noise", "round"))).get(quantiser, quantiser)
        mirrors = tuple(AtlasTexture(e, e, wide, stored) for e in p.mirrors)
        count = p.mirror_channels if mirrors else 0
        made = LightmapNetwork(texture, p.channels, width, p.hidden, p.activation, bool(p.base), p.siren, p.stage)
        about = self._rows.width("about") if surface else 0
        error = AtlasTexture(edge, edge, packed, "frozen") if stored == "round" and p.stores_blocks else None
        if self.lamps is not None:
            made = LampLightmapNetwork.of(made, self.lamps.count, self.lamps.rank, self.lamps.features)
        return replace(
            made, mirrors=mirrors, mirror_channels=count, surface=surface, about=about, error=error,
            rounded=quantiser == PLACES[1],
        )  # fmt: skip

    @property
    def pictures(self) -> dict[str, Picture]:
        """Buffer name → picture of everything that is stored as one."""
        made = {} if self.base is None else {"e": self.base}
        made = made if self.lamps is None else self.lamps.stored
        made |= {"d": self.direction} if self.direction is not None and self.preset.stores_direction else {}
        return made | ({} if self.mask is None else {"m": self.mask}) | self.features

    # ------------------------------------------------------------------ fit

    def rows(self, query: LightmapQuery, far: int = 0) -> np.ndarray:
        """Compute the inputs of the network.

        Args:
            query: N queries.
            far: Level of the mip chain, ≥ 0.

        Returns:
            [N, 11 + I + A] float32 inputs; 3 R more with lamps in R pictures.
        """
        seen = Tabulated(row_graph(replace(self.nodes, far=far))) if far else self._rows
        found = seen(query)
        return np.concatenate([found[n] for n in COLUMNS if n in found], axis=1)

    def without_network(self, query: LightmapQuery) -> np.ndarray:
        """Compute the radiance where light arrives evenly, which is what a network of zeros makes.

        Args:
            query: N queries.

        Returns:
            [N, 3] radiance.
        """
        rows = self.rows(query)
        return self.unit * (rows[:, BASE] + rows[:, GLOSS] * rows[:, GAIN])

    def train(
        self,
        query: LightmapQuery,
        radiance: np.ndarray,
        weight: np.ndarray,
        steps: int,
        progress: Callable[[int], None] | None = None,
        part: WorkPart | None = None,
        shares: np.ndarray | None = None,
    ) -> None:
        """Fit to samples; without a network there is nothing to train.

        Args:
            query: N queries.
            radiance: [N, 3] radiance.
            weight: [N] importance weights; samples with weight 0 are left out.
            steps: Number of training steps.
            progress: Called with the number of the step, every 50 steps; ``GoodEnough`` from it ends the phase, because
                what follows makes the light map as it is stored.
            part: Part of the bake that stores a checkpoint per phase of quantisation; None: the training cannot be
                resumed.
            shares: [N, K, 3] radiance of each group of lamps, where they have switches.
        """
        if not self.preset.hidden:
            return
        good = np.isfinite(radiance).all(axis=1) & (weight > 0)
        order = np.random.default_rng((self.seed, int(good.sum()))).permutation(np.flatnonzero(good))
        target = (radiance[order] / self.unit).astype(np.float32)
        if self.lamps is None:
            made = lambda rows: TrainingSet.from_numpy(rows, target, weight[order])  # noqa: E731
        else:
            alone = None if shares is None else shares[order] / self.unit
            made = partial(lamp_rows, self.lamps, target, alone, weight[order], self.seed)
        data = [made(self.rows(query[order], m)) for m in self.levels]
        for name, quantiser, until in self._phases():
            if quantiser == "frozen":
                if self.nodes.learns_places:
                    self._lay_out(data[0].features)
                self._freeze()
            self.network = self._make_network(quantiser)
            if quantiser == "frozen" and self.preset.stage:
                self.network = replace(self.network, stage=())
            make = partial(self._phase_arrays, data, round(until * steps), steps, progress)
            self._adopt(part.part(phase=name).get("lightmap.phase", make, ARRAYS) if part else make())

    def _phases(self) -> Iterator[tuple[str, str, float]]:
        """(name, quantiser, share of the steps at its end) of each phase of the training."""
        first, then = PLACES if self.nodes.learns_places else ("noise", "round")
        yield first, first, ROUND_FROM
        rounds = CODEC_ROUNDS if self.preset.stores_blocks else 1
        for k in range(rounds):
            until = FREEZE_FROM if k + 1 == rounds else ROUND_FROM + (k + 1) / rounds * (FREEZE_FROM - ROUND_FROM)
            yield f"{then}-{k}" if k else then, then, until
        yield "frozen", "frozen", 1.0

    def _phase_arrays(self, data: list[Any], *arguments: Any) -> Arrays:
        """Train one phase; its last step, mean loss and parameters as arrays."""
        if (texture := self.network.error) is not None:
            # Straight-through: what the codec adds to the features of now is a constant until the next phase.
            values = self._laid_out(data[0].features) if self.nodes.learns_places else self.parameters["t0"]
            self.parameters["e0"] = codec_error(values, texture, self.preset.channels, self.preset.codec)
        self._phase(data, *arguments)
        step, loss = self.history.pop()
        return {"step": np.array(step), "loss": np.array(loss)} | prefixed("p", self.parameters)

    def _adopt(self, arrays: Arrays) -> None:
        """Take the result of ``_phase_arrays``, perhaps of an earlier run."""
        self.history.append((int(arrays["step"]), float(arrays["loss"])))
        self.parameters = under("p", arrays)

    @property
    def levels(self) -> range:
        """Levels of the mip chain that viewers may read."""
        anything = self.base is not None or self._feature_mips() > 0
        return range(self.mips + 1 if anything and not self.preset.stage else 1)

    def _from_afar(self, level: int) -> LightmapNetwork:
        """The network for reads of the atlas at a level of its mip chain."""
        texture = self.network.texture
        if texture is None or not level:
            return self.network
        own = int(np.clip(level + round(np.log2(self.preset.share)), 0, self._feature_mips()))
        return replace(self.network, texture=replace(texture, level=own))

    def _phase(self, data: list[Any], until: int, steps: int, progress: Callable[[int], None] | None) -> None:
        """Steps up to ``until`` with the quantiser as it is; a quarter of them read a random level of the mip chain."""
        settings = TrainingSettings(rate=self.preset.rate, batch=self.batch, patience=0, evaluate_every=max(steps, 1))
        trainer = Trainer(self.network, settings, self.seed)
        trainer.adopt(self.parameters, keep_moments=False)
        trainer.state.step = self.history[-1][0] if self.history else 0
        networks = [self._from_afar(m) for m in self.levels]
        losses, last = [], until
        while trainer.state.step < until:
            # Which level a step reads depends on (seed, step) alone, so that a resumed training repeats it.
            rng = np.random.default_rng((self.seed, 0xFA4, trainer.state.step))
            level = int(rng.integers(1, len(data))) if len(data) > 1 and rng.random() < self.far_share else 0
            trainer.network = networks[level]
            losses.append(trainer.step(data[level], steps))
            if progress and trainer.state.step % 50 == 0:
                dr.eval(losses[-1])
                try:
                    progress(trainer.state.step)
                except GoodEnough:
                    last = trainer.state.step
                    break
        self.parameters = trainer.parameters
        loss = float(np.mean([x.numpy() for x in losses])) if losses else float("nan")
        if losses and not np.isfinite(loss):
            raise RuntimeError("train: the light map's loss is not finite; look for broken targets or train again")
        self.history.append((last, loss))

    def _lay_out(self, rows: Any) -> None:
        """Store the features of the sine layers as a texture, in place of the layers."""
        if "t0" not in self.parameters:
            kept = {k: v for k, v in self.parameters.items() if k[0] not in "uv"}
            self.parameters = kept | {"t0": self._laid_out(rows)}

    def _laid_out(self, rows: Any) -> np.ndarray:
        """[texels, C] features of the sine layers: means of the rows [N, …] that lie in each texel."""
        texture: Any = self._make_network("frozen").texture
        used = self.preset.channels
        tensors = {k: mi.TensorXf(v) for k, v in self.parameters.items()}
        found, places = [], np.array(rows[:, PLACE])
        network = self._make_network(PLACES[0])
        made, begin = network.made, HEAD + network.inputs
        with dr.suspend_grad():
            for start in range(0, len(places), CHUNK):
                found.append(np.array(made(tensors, rows[start : start + CHUNK, begin : begin + network.about])))
        values = (np.concatenate(found) - FEATURE_LOW) / (FEATURE_HIGH - FEATURE_LOW)
        cell = np.minimum((places * [texture.width, texture.height]).astype(np.int64), texture.width - 1)
        cell = cell[:, 1] * texture.width + cell[:, 0]
        count = np.bincount(cell, minlength=texture.width * texture.height)
        sums = [np.bincount(cell, weights=values[:, k], minlength=len(count)) for k in range(used)]
        image = np.stack(sums, axis=1) / np.maximum(count, 1)[:, None]
        shape = (texture.height, texture.width)
        image = push_pull(image.reshape(*shape, used).astype(np.float32), (count > 0).reshape(shape))
        table = np.full((len(count), texture.channels), 0.5, np.float32)
        table[:, :used] = image.reshape(len(count), used)
        return table

    def _freeze(self) -> None:
        """Make the feature textures those of the file."""
        p, network = self.preset, self._make_network("frozen")
        if p.channels:
            values = self._baked_stage(network.texture) if p.stage else self.parameters["t0"]
            self._store("t0", network.texture, values, "f", p.channels)
        for k, mirror in enumerate(network.mirrors, 1):
            self._store(f"t{k}", mirror, self.parameters[f"t{k}"], f"r{k - 1}", p.mirror_channels)

    def _store(self, name: str, texture: AtlasTexture, values: np.ndarray, prefix: str, channels: int) -> None:
        """Pictures of one texture; its parameters become what they hold."""
        mips = self._feature_mips() if name == "t0" else 0
        pictures = feature_pictures(values, texture, channels, self.preset.codec, mips)
        self.features |= {f"{prefix}{k}": picture for k, picture in enumerate(pictures)}
        self.parameters[name] = read_back(pictures, texture, channels)
        self.parameters.pop("e0", None)

    def _feature_mips(self) -> int:
        return max(self.mips - round(-np.log2(self.preset.share)), 0)

    def _baked_stage(self, texture: AtlasTexture) -> np.ndarray:
        """[texels, C] features of the first stage at the texels, in [0, 1]."""
        y, x = np.mgrid[0 : texture.height, 0 : texture.width] + 0.5
        places = np.stack([x / texture.width, y / texture.height], axis=-1).reshape(-1, 2).astype(np.float32)
        tensors = {k: mi.TensorXf(v) for k, v in self.parameters.items()}
        with dr.suspend_grad():
            found = np.array(self.network.features(tensors, tensor(places)))
        values = np.full((len(places), texture.channels), 0.5, np.float32)
        values[:, : self.preset.channels] = (found - FEATURE_LOW) / (FEATURE_HIGH - FEATURE_LOW)
        self.parameters = {k: v for k, v in self.parameters.items() if k[0] not in "sc"}
        return values

    # ------------------------------------------------------------------ result

    def predict(self, query: LightmapQuery) -> np.ndarray:
        """Predict radiance, before rounding to the stored types.

        Args:
            query: N queries.

        Returns:
            [N, 3] radiance, reflectance included.
        """
        return self.network.evaluate(self.parameters, self.rows(query)) * self.unit

    @property
    def frame(self) -> dict[str, np.ndarray]:
        """Inputs of the graph that all points share, as the scene has them: dimmers of lamps."""
        return {} if self.lamps is None else {"lamps": np.ones(3 * self.lamps.count, np.float32)}

    def lower(self) -> Graph:
        """Return the shading graph that is written.

        Returns:
            The graph.
        """
        return self.nodes.lowered(self.features, self.parameters if self.preset.hidden else {})
