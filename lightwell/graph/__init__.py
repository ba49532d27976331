"""The shading graph: a small, versioned list of ops that says what a baked field computes.

NumPy defines the meaning (``evaluate``), Dr.Jit runs it inside kernels (``compile``), the web runtime prints it as GLSL
and WGSL. The contract is `format/FORMAT.md`.
"""

from lightwell.graph.buffers import Buffer as Buffer
from lightwell.graph.buffers import pack as pack
from lightwell.graph.builder import Builder as Builder
from lightwell.graph.compile import Compiled as Compiled
from lightwell.graph.compile import compile as compile
from lightwell.graph.compile import evaluate_drjit as evaluate_drjit
from lightwell.graph.evaluate import evaluate as evaluate
from lightwell.graph.graph import FRAME_INPUTS as FRAME_INPUTS
from lightwell.graph.graph import OUTPUT_WIDTHS as OUTPUT_WIDTHS
from lightwell.graph.graph import Graph as Graph
from lightwell.graph.graph import Node as Node
from lightwell.graph.ops import OPS as OPS
from lightwell.graph.quantise import pack_indices as pack_indices
from lightwell.graph.quantise import quantise as quantise
from lightwell.graph.serial import graph_from_json as graph_from_json
from lightwell.graph.serial import graph_to_json as graph_to_json
from lightwell.graph.serial import schema as schema
