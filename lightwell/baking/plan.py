"""From seconds to counts: how many shards and steps a budget buys on this machine.

The plan is measured once and written down; everything after it depends on the plan and the seed alone, so that a bake
that was killed and resumed ends with the same bytes.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from lightwell.files import write_atomically

# Share of a round's seconds that goes into tracing; the rest trains. Small networks are short of samples, not of steps:
# four times the samples lower the error by a fifth, twice the steps change nothing (Cornell box).
TRACE_SHARE = 0.65
# Share of the shards that the adaptive stage places where the error is.
ADAPTIVE_SHARE = 0.25
# Share of the steps before the adaptive stage.
FIRST_STEPS_SHARE = 0.4
# A fit on fewer shards or steps than this is not worth starting.
FEWEST_SHARDS, FEWEST_STEPS = 2, 100
# Memory bound: 128 shards of 2^16 samples with 90 features are 3 GB.
MOST_SHARDS = 128


@dataclass(frozen=True)
class Plan:
    """Counts of one field's rounds."""

    shards: int
    """Area-uniform shards."""
    adaptive_shards: int
    first_steps: int
    """Steps before the adaptive stage."""
    steps: int
    """Steps in all."""
    seconds_per_shard: float = 0.0
    seconds_per_step: float = 0.0

    def extended(self) -> Plan:
        """The plan of the next round: half as many shards again, as many steps again."""
        more = min(max(self.shards // 2, 1), max(MOST_SHARDS - self.shards - self.adaptive_shards, 0))
        fresh = max(self.steps - self.first_steps, FEWEST_STEPS)
        return replace(self, adaptive_shards=self.adaptive_shards + more, steps=self.steps + 2 * fresh)


def make_plan(seconds: float, seconds_per_shard: float, seconds_per_step: float) -> Plan:
    """Spend ``seconds`` on shards and steps by the shares above."""
    total_shards = int(TRACE_SHARE * seconds / max(seconds_per_shard, 1e-6))
    total_shards = min(max(total_shards, FEWEST_SHARDS), MOST_SHARDS)
    adaptive = int(ADAPTIVE_SHARE * total_shards)
    left = seconds - total_shards * seconds_per_shard
    steps = max(int(left / max(seconds_per_step, 1e-6)), FEWEST_STEPS)
    first = max(int(FIRST_STEPS_SHARE * steps), 1)
    return Plan(total_shards - adaptive, adaptive, first, steps, seconds_per_shard, seconds_per_step)


def save_plan(path: Path, plan: Plan) -> None:
    """Write the plan, whole or not at all."""
    write_atomically(path, json.dumps(asdict(plan)))


def load_plan(path: Path) -> Plan:
    """Read a plan that ``save_plan`` wrote."""
    return Plan(**json.loads(path.read_text()))
