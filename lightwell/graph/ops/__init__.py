"""The ops of the shading graph. Importing this package registers those of all of its files."""

from importlib import import_module
from pkgutil import iter_modules

from lightwell.graph.ops.op import OPS as OPS
from lightwell.graph.ops.op import Op as Op
from lightwell.graph.ops.op import Parameter as Parameter
from lightwell.graph.ops.op import Use as Use

for _found in iter_modules(__path__, f"{__name__}."):
    import_module(_found.name)
