"""The formats that are fuzzed: seeds, mutator and reader of each."""

from __future__ import annotations

import functools
import random
from collections.abc import Callable
from dataclasses import dataclass

import fuzz_containers as containers
import fuzz_learned as learned
import fuzz_seeds as seeds
from fuzz_mutate import mutate_bytes, mutate_json
from fuzz_seeds import Case
from fuzz_xml import mutate_obj, mutate_ply, mutate_xml


@dataclass(frozen=True)
class Format:
    """One kind of file."""

    name: str
    make_seeds: Callable[[], list[Case]]
    mutate: Callable[[random.Random, Case], bytes]
    """New bytes of the file of a case that mutations change."""
    reader: str
    """A function of ``fuzz_readers``."""

    @property
    def seeds(self) -> list[Case]:
        """Sound files."""
        return _made(self.make_seeds)

    def mutant(self, seed: int | str, index: int) -> Case:
        """Mutant ``index``: a seed with its file changed, a function of the arguments alone."""
        rng = random.Random(f"{seed}/{self.name}/{index}")
        case = rng.choice(self.seeds)
        return case.changed(self.mutate(rng, case))


@functools.cache
def _made(make: Callable[[], list[Case]]) -> list[Case]:
    return make()


def _plain(mutate: Callable[[random.Random, bytes], bytes]) -> Callable[[random.Random, Case], bytes]:
    return lambda rng, case: mutate(rng, case.data)


def _json(rng: random.Random, case: Case) -> bytes:
    return mutate_bytes(rng, case.data) if rng.random() < 0.2 else mutate_json(rng, case.data)


def _picture(rng: random.Random, case: Case) -> bytes:
    return (containers.mutate_jpeg if case.mutated.endswith(".jpg") else containers.mutate_png)(rng, case.data)


def _shard(rng: random.Random, case: Case) -> bytes:
    return _json(rng, case) if case.mutated.endswith(".json") else containers.mutate_array(rng, case.data)


_ALL = (
    Format("gltf", seeds.gltf_rooms, _json, "scene"),
    Format("glb", seeds.glb_rooms, _plain(containers.mutate_glb), "scene"),
    Format("xml", seeds.xml_rooms, _plain(mutate_xml), "scene"),
    Format("ply", functools.partial(seeds.mesh_rooms, "ply"), _plain(mutate_ply), "scene"),
    Format("obj", functools.partial(seeds.mesh_rooms, "obj"), _plain(mutate_obj), "scene"),
    Format("texture", seeds.textures, _picture, "scene"),
    Format("hdr", seeds.environments, _plain(containers.mutate_hdr), "scene"),
    Format("exr", seeds.frames, _plain(mutate_bytes), "frame"),
    Format("asset", learned.assets, _plain(containers.mutate_glb), "asset"),
    Format("lwp", learned.probes, lambda rng, case: containers.mutate_header(rng, case.data, 8), "probes"),
    Format("lwsp", learned.libraries, lambda rng, case: containers.mutate_header(rng, case.data, 8), "library"),
    Format("cache", learned.caches, _plain(containers.mutate_archive), "cache"),
    Format("checkpoint", learned.checkpoints, _plain(containers.mutate_archive), "checkpoint"),
    Format("shards", learned.shards, _shard, "shards"),
)
FORMATS = {format_.name: format_ for format_ in _ALL}
