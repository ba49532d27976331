"""Options of verbs that trace on many machines. The command line is made from this module: it imports nothing slow."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lightwell.core.options import option

# Kinds of clusters: what stands before the colon.
KINDS = ("local", "tcp", "tls", "ssh", "slurm", "k8s")


def parse_cluster(text: str) -> str:
    """Check the address of a cluster.

    Args:
        text: 'local:4', 'tcp://host:8786', 'tls://host:8786', 'ssh:HOSTFILE', 'slurm:FILE' or 'k8s:FILE'.

    Returns:
        The text.

    Raises:
        ValueError: The text is none of these.
    """
    kind, _, rest = text.partition(":")
    fine = kind in KINDS and bool(rest)
    if kind in ("tcp", "tls"):
        fine = rest.startswith("//") and rest[2:].rpartition(":")[2].isdigit()
    if kind == "local":
        fine = rest.isdigit() and int(rest) > 0
    if not fine:
        raise ValueError(
            f"'{text[:60]}' is no cluster; write local:4, tcp://host:8786, tls://host:8786, ssh:HOSTFILE, slurm:FILE "
            "or k8s:FILE"
        )
    return text


@dataclass(frozen=True, kw_only=True)
class ClusterOptions:
    """Where paths are traced."""

    cluster: str | None = option(
        None,
        "trace on other processes or machines with Dask: local:N, tcp://host:port, tls://host:port, ssh:HOSTFILE, "
        "slurm:FILE or k8s:FILE (default: in this process)",
        parse=parse_cluster,
        metavar="WHERE",
        group="many machines",
    )
    cluster_tls: Path | None = option(
        None,
        "folder with ca.pem, cert.pem and key.pem for a cluster whose connections are encrypted",
        parse=Path,
        metavar="DIR",
        group="many machines",
    )
    store: Path | None = option(
        None,
        "folder in which results of --cluster are kept between runs (default: LIGHTWELL_STORE, else the platform's for "
        "caches)",
        parse=Path,
        metavar="DIR",
        group="many machines",
    )
    allow_mixed: bool = option(
        False,
        "take workers whose processors or libraries give other bytes: the result is as good but not repeatable",
        group="many machines",
    )


# Names of these options: they change where work is done, not what is computed.
NAMES = ("cluster", "cluster_tls", "store", "allow_mixed")
