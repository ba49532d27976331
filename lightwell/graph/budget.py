"""What a graph may ask of one pixel, one frame and one shader (format/FORMAT.md, *Budget*).

Counted before anything is evaluated or printed, so that a small file cannot ask for a large amount of work. The numbers
are those of ``format/budget.json``, which the web runtime holds too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from lightwell.graph.ops import OPS

if TYPE_CHECKING:
    from lightwell.graph.graph import Graph, Node
    from lightwell.graph.ops import Use


@dataclass(frozen=True)
class GraphBudget:
    """Limits of the work of a graph."""

    work: int = 100_000
    """Per pixel: multiply-adds, components of values, numbers read from tables; four times the largest preset."""
    work_per_frame: int = 1_000_000
    """The same for the ``per_frame`` nodes, once a frame."""
    live: int = 2_048
    """Components needed at the same time in a pixel: the 8,192 bytes of a function's variables (WGSL, *Limits*)."""
    text: int = 1_000_000
    """Characters of a shader's text."""


BUDGET = GraphBudget()


def work_of(node: Node, use: Use, width: int) -> int:
    """Count the work of a node: multiply-adds, the widest value that it touches, numbers that it reads from tables.

    Args:
        node: The node.
        use: Its parameters and buffers.
        width: Components of its value.

    Returns:
        Operations per evaluation.
    """
    op = OPS[node.op]
    table = next(iter(use.buffers.values()), None)
    fetched = op.fetches(use) * table.shape[-1] if table is not None else 0
    return op.macs(use) + fetched + max(width, *use.widths)


def graph_work(graph: Graph, per_frame: bool = False) -> int:
    """Sum up the work of a graph.

    Args:
        graph: Graph to count.
        per_frame: Count the nodes that run once a frame instead of those of a pixel.

    Returns:
        Operations per pixel, or per frame.
    """
    pairs = [(node, use) for node, use in zip(graph.nodes, graph.uses) if node.per_frame == per_frame]
    return sum(work_of(node, use, graph.widths[node.id]) for node, use in pairs)


def live_numbers(graph: Graph) -> int:
    """Count the components that a pixel needs at the same time; what is evaluated once a frame lies elsewhere.

    Args:
        graph: Graph to count.

    Returns:
        The largest number over all nodes, each value rounded up to a multiple of four as shaders store it.
    """
    nodes = [node for node in graph.nodes if not node.per_frame]
    last = {name: i for i, node in enumerate(nodes) for name in node.inputs}
    last |= dict.fromkeys(graph.outputs.values(), len(nodes))
    size = {name: -(-width // 4) * 4 for name, width in graph.widths.items()}
    ending = [0] * (len(nodes) + 1)
    for name in [*graph.inputs, *(node.id for node in nodes)]:
        if name in last:
            ending[last[name]] += size[name]
    live = sum(size[name] for name in graph.inputs if name in last)
    most = live
    for i, node in enumerate(nodes):
        live += size[node.id] if node.id in last else 0
        most = max(most, live)
        live -= ending[i]
    return most


def check_budget(graph: Graph, budget: GraphBudget = BUDGET) -> None:
    """Refuse a graph that asks for more than a budget.

    Args:
        graph: Graph to count.
        budget: What it may ask for.

    Raises:
        ValueError: What it asks for, the limit, and the cure, in one line.
    """
    counted = (
        ("work", graph_work(graph), "operations per pixel"),
        ("work_per_frame", graph_work(graph, per_frame=True), "operations per frame"),
        ("live", live_numbers(graph), "numbers needed at a time"),
    )
    for name, found, what in counted:
        limit = getattr(budget, name)
        if found > limit:
            raise ValueError(
                f"graph: nodes: expected at most {limit} {what}, found {found}; use a smaller field, "
                f"or raise the budget's '{name}' if you trust the file"
            )
