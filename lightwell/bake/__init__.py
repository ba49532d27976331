"""The main job: a scene in, a glTF lit by learned light, a page and a report out."""

from lightwell.bake.pipeline import bake as bake
from lightwell.bake.settings import BakeSettings as BakeSettings
from lightwell.bake.settings import Budget as Budget
