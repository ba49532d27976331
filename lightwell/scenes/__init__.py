"""Loading of scenes: one ``Scene`` record from glTF, Mitsuba XML or a builtin name."""

from lightwell.scenes.assemble import assemble as assemble
from lightwell.scenes.errors import SceneError as SceneError
from lightwell.scenes.load import BUILTINS as BUILTINS
from lightwell.scenes.load import load as load
from lightwell.scenes.scene import Camera as Camera
from lightwell.scenes.scene import Image as Image
from lightwell.scenes.scene import Light as Light
from lightwell.scenes.scene import Material as Material
from lightwell.scenes.scene import Mesh as Mesh
from lightwell.scenes.scene import Scene as Scene
from lightwell.scenes.scene import Texture as Texture
