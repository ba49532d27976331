"""The main job: a scene in, a glTF lit by learned light, a page and a report out."""

from lightwell.baking.pipeline import bake as bake
from lightwell.baking.settings import BakeSettings as BakeSettings
from lightwell.baking.settings import Budget as Budget
