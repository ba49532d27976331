"""``lightwell_nrc``: rendering with the radiance cache as a Mitsuba integrator."""

from __future__ import annotations

import time
from typing import Any, NoReturn

from lightwell.backend import dr, mi
from lightwell.cache import views
from lightwell.cache.checks import check_scene, check_sensor, check_variant
from lightwell.cache.denoising import check_film, denoised_image
from lightwell.cache.image_passes import ImagePasses
from lightwell.cache.image_state import ImageState, train_frame
from lightwell.cache.radiance_cache import RadianceCache
from lightwell.cache.reservoir_history import ReservoirHistory
from lightwell.cache.settings import CacheSettings, settings_of
from lightwell.cache.still_training import WORTH, train_still
from lightwell.cache.temporal import TemporalHistory

check_variant(mi.variant())


class NrcIntegrator(mi.ad.integrators.common.ADIntegrator):
    """Neural radiance cache: a path tracer that trains a small network while it renders.

    Every parameter of ``CacheSettings`` is a parameter of the plugin, in XML and in dictionaries, for example
    ``preset`` ('compact' or 'paper'), ``termination_c`` (0.01; infinity is plain path tracing), ``estimator``
    ('biased', or the unbiased 'guided', 'residual' and 'two-level'), ``first_hit`` ('nee', 'restir-di').

    Paths follow Mitsuba's ``path`` until their footprint is wide enough; there the network predicts the radiance that
    the surface scatters, and the path ends. The network is trained on a few paths per frame. The cache belongs to the
    integrator object and the scene: rendering the same scene again continues the training.

    Not supported: participating media, polarisation, spectral variants, derivatives of the image.

    Paper: Müller et al. 2021, *Real-time Neural Radiance Caching for Path Tracing*. This is an independent
    implementation.
    """

    def __init__(self, props: Any = None, settings: CacheSettings | None = None) -> None:
        """Read the parameters.

        Args:
            props: Mitsuba properties of the plugin; None: the defaults.
            settings: Settings; None: those of ``props``.
        """
        if props is None:
            props = mi.Properties("lightwell_nrc")
        if settings is None:
            settings = settings_of({name: props[name] for name in props.keys()})
        base = mi.Properties("lightwell_nrc")
        base["max_depth"], base["rr_depth"] = settings.paths.max_depth, settings.paths.rr_depth
        super().__init__(base)
        self.settings = settings
        self.cache: RadianceCache | None = None
        """Made when a scene is first rendered; assign a trained one to start from it."""
        self.reservoirs = ReservoirHistory(settings.estimation)
        """Reservoirs of the last pass."""
        self.temporal = TemporalHistory(settings.image.denoise_frames)
        """Average of denoised frames."""
        self.last: ImageState | None = None
        """The last image: statistics of its training, seconds, samples."""
        self.worth = WORTH
        """See ``still_training.WORTH``; 0: a still with a time limit is never path traced for being too short."""
        self._scene: Any = None

    def to_string(self) -> str:
        """Describe the integrator in one line.

        Returns:
            Text with preset, threshold and estimator.
        """
        s = self.settings
        c, estimator = s.paths.termination_c, s.estimation.estimator
        return f"NrcIntegrator[preset = {s.preset}, c = {c:g}, estimator = {estimator}]"

    # ------------------------------------------------------------------ the cache

    def cache_of(self, scene: Any) -> RadianceCache:
        """Return the cache of a scene; it is made on first use and prepared again for another scene.

        Args:
            scene: Mitsuba scene.

        Returns:
            The cache, ready for the scene.
        """
        if self.cache is None or (self._scene is not None and self._scene is not scene):
            self.cache = RadianceCache(self.settings)
            self.reservoirs.forget()
            self.temporal.forget()
        if self._scene is not scene or self.cache.region.materials is None:
            check_scene(scene)
            self.cache.prepare(scene)
            self._scene = scene
        return self.cache

    def scene_changed(self, kind: str = "light") -> None:
        """Announce a change of the scene.

        Args:
            kind: 'light', 'material', 'geometry' or 'camera'.
        """
        if self.cache is not None and self._scene is not None:
            self.cache.scene_changed(kind, self._scene)
            self.reservoirs.forget()
            if kind != "camera":
                self.temporal.forget()

    # ------------------------------------------------------------------ rendering

    def render(
        self, scene: Any, sensor: Any = 0, seed: Any = 0, spp: int = 0, develop: bool = True, evaluate: bool = True
    ) -> Any:  # fmt: skip
        """Render an image and train the cache meanwhile.

        Args:
            scene: Mitsuba scene.
            sensor: Mitsuba sensor, or its index in the scene.
            seed: Seed; the same seed, settings and cache give the same image.
            spp: Samples per pixel; 0: those of the sensor's sampler.
            develop: Ignored; the image is always developed.
            evaluate: Ignored; the image is always evaluated.

        Returns:
            [H, W, C] tensor, linear RGB first.
        """
        if isinstance(sensor, int):
            sensor = scene.sensors()[sensor]
        check_sensor(sensor)
        if self.settings.image.denoise:
            check_film(sensor)
        seed = int(mi.UInt32(seed)[0]) if not isinstance(seed, int) else seed
        image = self._image(scene, sensor, seed, spp or int(sensor.sampler().sample_count()))
        with dr.suspend_grad():
            sensor.film().prepare([])
            if image.still:
                train_still(image, self.worth)
            if self.settings.image.view != "image":
                return self._view(image)
            start, trained = time.perf_counter(), image.seconds["train"]
            picture = ImagePasses(image).render()
            dr.eval(picture)
            image.seconds["trace"] += time.perf_counter() - start - (image.seconds["train"] - trained)
            return denoised_image(image, picture, self.temporal) if self.settings.image.denoise else picture

    def _image(self, scene: Any, sensor: Any, seed: int, spp: int) -> ImageState:
        self.last = ImageState(self.settings, scene, sensor, self.cache_of(scene), self.reservoirs, seed, spp)
        return self.last

    def warm_up(self, scene: Any, sensor: Any, seed: int, spp: int) -> ImageState:
        """Train as before a still, without rendering it.

        Args:
            scene: Mitsuba scene.
            sensor: Mitsuba sensor.
            seed: Seed.
            spp: Samples per pixel of the still, which set the number of frames.

        Returns:
            The state of the still, with the statistics of the training.
        """
        image = self._image(scene, sensor, seed, spp)
        train_still(image, self.worth)
        return image

    @staticmethod
    def _view(image: ImageState) -> mi.TensorXf:
        """Render a debug view, after the training of an image."""
        for _ in range(0 if image.still else image.spp):
            train_frame(image)
        settings, scene, sensor = image.settings, image.scene, image.sensor
        if settings.image.view != "reservoir":
            return mi.TensorXf(views.view(scene, sensor, image.cache, settings.image.view, image.spp, image.seed))
        if settings.estimation.first_hit == "nee":
            raise ValueError("nrc: view 'reservoir' needs first_hit = 'restir-di'")
        image.reservoirs.direct(scene, ImagePasses(image).rays(image.seed, 0, 1, 1), sensor, 1)
        return mi.TensorXf(image.reservoirs.picture(sensor))

    def render_forward(self, *args: Any, **kwargs: Any) -> NoReturn:
        """Refuse: the integrator has no derivatives of the image.

        Args:
            *args: Ignored.
            **kwargs: Ignored.

        Raises:
            RuntimeError: Always.
        """
        raise RuntimeError("nrc: lightwell_nrc gives no derivatives of the picture; use 'prb' for them")

    render_backward = render_forward


def register() -> None:
    """Register ``lightwell_nrc`` with the active Mitsuba variant."""
    mi.register_integrator("lightwell_nrc", lambda props: NrcIntegrator(props))
