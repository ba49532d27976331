"""lightwell learns the indirect light of a scene and plays it back in real time.

    import lightwell

    scene = lightwell.load("room.glb")
    report = lightwell.bake("room.glb", "out", budget="5m")
    print(report.verdict, report["relative_error"])

Names are imported when they are first used, so that ``import lightwell`` takes milliseconds. ``lightwell.lens`` is
the module of depth of field and motion blur.
"""

# Nothing is imported here, not even typing: until ``lightwell.__main__`` runs, Ctrl-C prints a traceback.
TYPE_CHECKING = False

__version__ = "0.1.0"

if TYPE_CHECKING:
    from typing import Any

    from lightwell import lens as lens
    from lightwell.api import Asset as Asset
    from lightwell.api import Comparison as Comparison
    from lightwell.api import Report as Report
    from lightwell.api import bake as bake
    from lightwell.api import compare as compare
    from lightwell.api import read as read
    from lightwell.api import render as render
    from lightwell.api import samples as samples
    from lightwell.baking.settings import BakeSettings as BakeSettings
    from lightwell.cache import CacheSettings as CacheSettings
    from lightwell.cache import RadianceCache as RadianceCache
    from lightwell.fields.budget import Budget as Budget
    from lightwell.limits import Limits as Limits
    from lightwell.rendering.settings import RenderSettings as RenderSettings
    from lightwell.scenes import Scene as Scene
    from lightwell.scenes.load import load as load

# Name → module that holds it; None: the module of that name.
_HOMES: dict[str, str | None] = {
    "Asset": "lightwell.api",
    "BakeSettings": "lightwell.baking.settings",
    "Budget": "lightwell.fields.budget",
    "CacheSettings": "lightwell.cache",
    "Comparison": "lightwell.api",
    "Limits": "lightwell.limits",
    "RadianceCache": "lightwell.cache",
    "RenderSettings": "lightwell.rendering.settings",
    "Report": "lightwell.api",
    "Scene": "lightwell.scenes",
    "bake": "lightwell.api",
    "compare": "lightwell.api",
    "lens": None,
    "load": "lightwell.scenes",
    "read": "lightwell.api",
    "render": "lightwell.api",
    "samples": "lightwell.api",
}

__all__ = sorted([*_HOMES, "__version__"])


def __getattr__(name: str) -> "Any":
    from importlib import import_module

    if name not in _HOMES:
        raise AttributeError(f"module 'lightwell' has no attribute '{name}'; it has {', '.join(__all__)}")
    home = _HOMES[name]
    found = import_module(f"lightwell.{name}") if home is None else getattr(import_module(home), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])
