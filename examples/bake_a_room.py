"""Bake a built-in scene from Python, at toy size: python examples/bake_a_room.py [OUT]

The counts below keep it short; the result shows how the parts fit together, not how good they can be.
"""

import sys
from pathlib import Path

import lightwell

report = lightwell.bake(
    "two-rooms",
    Path(sys.argv[1] if len(sys.argv) > 1 else "out/two-rooms"),
    # The light stays in the warm room; the cool one gets what comes through the door.
    vary=["light.position=box(-2.6,0.5,-1.3,-0.5,2.1,1.3)"],
    # Fixed counts instead of a budget of seconds: they do not depend on the speed of the machine.
    shards=2,
    steps=200,
    paths=8,
    lights_per_shard=32,
    views=2,
    view_size=(64, 40),
    # A second of path tracing to compare with; a bake of minutes takes more.
    truth="1s",
)
print(f"relative error {report['relative_error']:.1%}, noise of the truth {report['noise_floor']:.1%}")
print(f"{report['bytes']:,} bytes of learned light in {report.asset}")
