"""Reservoirs against plain light sampling."""

import numpy as np
import pytest

from lightwell.backend import mi
from lightwell.cache import NrcIntegrator, restir, settings_of

from .scenes import T, room


def _direct(scene, spp, seed, **options):
    nrc = NrcIntegrator(settings=settings_of({"termination_c": "inf", "max_depth": 2, **options}))
    return np.array(mi.render(scene, integrator=nrc, spp=spp, seed=seed))


@pytest.mark.parametrize("reuse", ["unbiased", "biased"])
def test_the_mean_is_that_of_light_sampling(reuse):
    scene = room(24)
    means = {"nee": [], "restir-di": []}
    for seed in range(12):
        for kind, values in means.items():
            values.append(_direct(scene, 4, seed, first_hit=kind, restir_reuse=reuse).mean())
    ours, theirs = (np.array(means[k]) for k in ("restir-di", "nee"))
    z = (ours.mean() - theirs.mean()) / np.sqrt((ours.var(ddof=1) + theirs.var(ddof=1)) / 12)
    if reuse == "unbiased":
        assert abs(z) < 3.3  # 99.9 %
    assert abs(ours.mean() / theirs.mean() - 1) < (0.02 if reuse == "unbiased" else 0.15)


@pytest.mark.parametrize("reuse", ["unbiased", "biased"])
def test_bounced_light_from_reservoirs_has_the_path_traced_mean(reuse):
    scene = room(24)
    path = mi.load_dict({"type": "path", "max_depth": -1})
    ours, theirs = [], []
    for seed in range(16):
        options = {"termination_c": "inf", "first_hit": "restir-gi", "restir_reuse": reuse, "sampling": "sensor"}
        nrc = NrcIntegrator(settings=settings_of(options))
        ours.append(np.array(mi.render(scene, integrator=nrc, spp=8, seed=seed)).mean())
        theirs.append(np.array(mi.render(scene, integrator=path, spp=8, seed=500 + seed)).mean())
    ours, theirs = np.array(ours), np.array(theirs)
    z = (ours.mean() - theirs.mean()) / np.sqrt((ours.var(ddof=1) + theirs.var(ddof=1)) / 16)
    if reuse == "unbiased":
        assert abs(z) < 3.3  # 99.9 %
    assert abs(ours.mean() / theirs.mean() - 1) < (0.02 if reuse == "unbiased" else 0.2)


def test_a_wrong_jacobian_would_be_seen(monkeypatch):
    """The planted bug: neighbours' samples without the change of measure."""
    from lightwell.cache import restir_gi

    real = restir_gi.reached
    monkeypatch.setattr(
        restir_gi, "reached", lambda *a: (lambda v, c, d: (v, c, d * 2))(*real(*a))
    )  # half the weight of every moved sample
    scene = room(24)
    path = mi.load_dict({"type": "path", "max_depth": -1})
    nrc = NrcIntegrator(settings=settings_of({"termination_c": "inf", "first_hit": "restir-gi",
                                              "restir_reuse": "unbiased"}))  # fmt: skip
    ours = np.array(mi.render(scene, integrator=nrc, spp=64, seed=1)).mean()
    assert abs(ours / np.array(mi.render(scene, integrator=path, spp=64, seed=2)).mean() - 1) > 0.03


def test_the_past_follows_its_surface_when_the_camera_moves():
    scene = room(32)
    moved = lambda x: mi.Transform4f(T().look_at(origin=[x, 0, -0.9], target=[x, 0, 1], up=[0, 1, 0]).matrix)  # noqa: E731
    nrc = NrcIntegrator(settings=settings_of({"termination_c": "inf", "max_depth": 2, "first_hit": "restir-di"}))
    parameters = mi.traverse(scene)
    key = next(k for k in parameters.keys() if k.endswith("to_world") and "sensor" in k)
    for seed in range(4):
        parameters[key] = moved(0.05 * seed)
        parameters.update()
        mi.render(scene, integrator=nrc, spp=1, seed=seed)
        held = np.array(nrc.reservoirs.held.M)
        candidates = nrc.settings.estimation.restir_candidates
        if seed:
            assert (held > candidates).mean() > 0.7  # most surfaces brought their past along
        else:
            assert (held <= candidates).all()


def test_a_point_is_found_where_the_camera_saw_it():
    scene = room(32)
    film = restir.world_to_film(scene.sensors()[0])
    ray, _ = scene.sensors()[0].sample_ray(0.0, 0.0, mi.Point2f(0.3, 0.8), mi.Point2f(0.5))
    at = film @ scene.ray_intersect(ray).p
    assert np.allclose([float(at.x[0]), float(at.y[0])], [0.3, 0.8], atol=1e-4)


@pytest.mark.parametrize("options", [{"estimator": "residual"}, {"estimator": "guided"}, {"guide": "always"}])
def test_bounced_light_from_reservoirs_has_no_other_estimator(options):
    with pytest.raises(ValueError, match=r"first_hit=restir-gi has no (estimator|guide)="):
        settings_of({"first_hit": "restir-gi", **options})
