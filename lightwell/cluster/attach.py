"""Gives a scene the executor that its settings ask for; Dask is imported only then."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from lightwell.core.cluster_options import ClusterOptions
from lightwell.scenes.scene import Scene


@contextmanager
def attached(
    scene: Scene, loading: Mapping[str, Any], options: ClusterOptions, say: Callable[[str], None]
) -> Iterator[None]:
    """Trace a scene on a cluster for the time of a block, if one is asked for.

    Args:
        scene: The scene; its ``executor`` is set.
        loading: Options with which it was loaded.
        options: The cluster; none: nothing happens.
        say: Takes lines for the terminal.

    Yields:
        Nothing.

    Raises:
        ValueError: Dask is not installed, or the cluster cannot be reached or started; one line with the cure.
    """
    if options.cluster is None:
        yield
        return
    try:
        from lightwell.cluster.connect import connected
    except ModuleNotFoundError as error:
        raise ValueError(f'--cluster needs the package {error.name}; pip install "lightwell[cluster]"') from None
    with connected(scene, dict(loading), options, say) as executor:
        scene.executor = executor
        try:
            yield
        finally:
            scene.executor = None
