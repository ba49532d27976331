"""Clusters by address: local processes, a running scheduler, ssh, Slurm, Kubernetes.

What this module starts listens on the loopback interface alone, except for ssh, Slurm and Kubernetes, whose machines
must reach each other.
"""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from lightwell.cluster.executor import DaskExecutor
from lightwell.cluster.roster import Roster
from lightwell.cluster.worker import SceneSource, fingerprint
from lightwell.core.cluster_options import ClusterOptions
from lightwell.core.store import user_store
from lightwell.machine import THREADS_VARIABLE, threads
from lightwell.scenes.scene import Scene

# Files of a folder of --cluster-tls.
TLS = ("ca.pem", "cert.pem", "key.pem")
# Seconds until a scheduler must answer.
ANSWER = 30
# Workers that a file of Slurm or Kubernetes asks for, unless it says so.
WORKERS = 2


@contextmanager
def connected(
    scene: Scene, loading: dict[str, Any], options: ClusterOptions, say: Callable[[str], None]
) -> Iterator[DaskExecutor]:
    """Connect to a cluster, or start it, for the time of a block.

    Args:
        scene: The scene that workers need.
        loading: Options with which it was loaded.
        options: The cluster.
        say: Takes lines for the terminal.

    Yields:
        The executor.

    Raises:
        ValueError: The cluster cannot be reached or started; one line with the cure.
    """
    from distributed import Client

    logging.getLogger("distributed").setLevel(logging.ERROR)
    assert options.cluster is not None
    with ExitStack() as stack:
        security = security_of(options.cluster_tls)
        address = _started(options.cluster, security, stack)

        def connect() -> Client:
            return Client(address, security=security, timeout=ANSWER, set_as_default=False)

        try:
            client = connect()
        except (OSError, TimeoutError) as error:
            raise ValueError(
                f"--cluster {options.cluster}: no scheduler answers ({type(error).__name__}); start one with "
                "'dask scheduler', or check address and --cluster-tls"
            ) from None
        if "bokeh" in sys.modules and client.dashboard_link:
            say(f"cluster: {client.dashboard_link}")
        source = SceneSource(_absolute(scene.source), scene.digest, loading)
        roster = Roster(client, source, fingerprint(), say, options.allow_mixed)
        near = options.cluster.startswith("local:")
        executor = DaskExecutor(scene, roster, connect, user_store(options.store), say, near=near)
        try:
            yield executor
            say(executor.summary())
            if roster.mixed:
                say("[yellow]cluster: workers of different bytes took part; the result is not repeatable bit by bit")
        finally:
            roster.client.close()


def _absolute(source: str) -> str:
    """The name of a built-in scene, or the absolute path of a file."""
    return source.removeprefix("builtin:") if source.startswith("builtin:") else str(Path(source).resolve())


def _started(text: str, security: Any, stack: ExitStack) -> Any:
    """The address of a running scheduler, or a cluster that is started and ends with the stack."""
    kind, _, rest = text.partition(":")
    if kind in ("tcp", "tls"):
        return text
    start = {"local": _local, "ssh": _ssh, "slurm": _slurm, "k8s": _kubernetes}[kind]
    return stack.enter_context(start(rest, security))


def _local(rest: str, security: Any) -> Any:
    from distributed import LocalCluster

    count = int(rest)
    return LocalCluster(
        n_workers=count, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address="127.0.0.1:0",
        env={THREADS_VARIABLE: str(max(threads() // count, 1)), "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        security=security, silence_logs=logging.ERROR,
    )  # fmt: skip


def _ssh(rest: str, security: Any) -> Any:
    try:
        import asyncssh  # noqa: F401
        from distributed import SSHCluster
    except ImportError:
        raise ValueError("--cluster ssh: needs the package asyncssh; pip install asyncssh") from None
    try:
        lines = Path(rest).read_text().split("\n")
    except OSError as error:
        raise ValueError(f"--cluster ssh: cannot read '{rest}' ({error.strerror}); name a file of host names") from None
    hosts = [line.strip() for line in lines if line.strip() and not line.strip().startswith("#")]
    if len(hosts) < 2:
        raise ValueError(f"--cluster ssh: '{rest}' names {len(hosts)} hosts; first the scheduler's, then the workers'")
    return SSHCluster(hosts, worker_options={"nthreads": 1}, security=security)


def _slurm(rest: str, security: Any) -> Any:
    try:
        from dask_jobqueue import SLURMCluster
    except ImportError:
        raise ValueError('--cluster slurm: needs dask-jobqueue; pip install "lightwell[cluster]"') from None
    options = read_profile(rest, "slurm")
    count = options.pop("workers", WORKERS)
    usual = {"processes": 1, "cores": 1, "memory": "8GB", "scheduler_options": {"dashboard_address": ":0"}}
    cluster = SLURMCluster(**{**usual, "security": security, **options})
    cluster.scale(count)
    return cluster


def _kubernetes(rest: str, security: Any) -> Any:
    try:
        from dask_kubernetes.operator import KubeCluster
    except ImportError:
        raise ValueError("--cluster k8s: needs the package dask-kubernetes; pip install dask-kubernetes") from None
    return KubeCluster(**read_profile(rest, "k8s"))


def read_profile(path: str, kind: str) -> dict[str, Any]:
    """Read the options of a cluster from a TOML file.

    Args:
        path: The file.
        kind: Kind of the cluster, 'slurm' or 'k8s'.

    Returns:
        Arguments of Dask's class by name, and ``workers`` of Slurm.

    Raises:
        ValueError: The file cannot be read, or its ``workers`` are no number; one line.
    """
    if sys.version_info >= (3, 11):
        import tomllib
    else:
        import tomli as tomllib
    try:
        options = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise ValueError(f"--cluster {kind}: cannot read '{path}' ({error.strerror}); see docs/cluster.md") from None
    except ValueError as error:
        raise ValueError(f"--cluster {kind}: '{path}' is not TOML ({error}); correct that line") from None
    workers = options.get("workers", WORKERS)
    if type(workers) is not int or workers < 1:
        raise ValueError(f"--cluster {kind}: workers = {workers!r} in '{path}' is no count; write workers = 8")
    if kind == "k8s":
        # What Dask's class for Kubernetes calls them.
        options = {"n_workers": workers} | {name: value for name, value in options.items() if name != "workers"}
    return options


def security_of(folder: Path | None) -> Any:
    """Read the keys of an encrypted cluster.

    Args:
        folder: Folder with certificate, key and authority; None: not encrypted.

    Returns:
        ``distributed``'s ``Security``, or None.

    Raises:
        ValueError: A file is missing.
    """
    if folder is None:
        return None
    from distributed.security import Security

    ca, cert, key = (str(folder / name) for name in TLS)
    for name in (ca, cert, key):
        if not Path(name).is_file():
            raise ValueError(f"--cluster-tls: there is no '{name}'; the folder holds {', '.join(TLS)}")
    return Security(tls_ca_file=ca, tls_client_cert=cert, tls_client_key=key, require_encryption=True)
