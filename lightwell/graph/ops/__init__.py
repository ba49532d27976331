"""The ops of the shading graph. Importing this package registers them all; one small file per group."""

from lightwell.graph.ops import (
    activate,
    arithmetic,
    encoding,
    fetch,
    geometry,
    hashgrid,
    linear,
    lookup,
    shape,
    top2,
    tree,
)
from lightwell.graph.ops.op import OPS as OPS
from lightwell.graph.ops.op import Op as Op
from lightwell.graph.ops.op import Parameter as Parameter
from lightwell.graph.ops.op import Use as Use

__all__ = [
    "OPS",
    "Op",
    "Parameter",
    "Use",
    "activate",
    "arithmetic",
    "encoding",
    "fetch",
    "geometry",
    "hashgrid",
    "linear",
    "lookup",
    "shape",
    "top2",
    "tree",
]
