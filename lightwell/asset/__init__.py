"""The baked asset: a glTF 2.0 file with its learned light, read and written, and the self-contained viewer page."""

from lightwell.asset.info import info as info
from lightwell.asset.page import PageView as PageView
from lightwell.asset.page import write_page as write_page
from lightwell.asset.read import read_fields as read_fields
from lightwell.asset.records import EXTENSION as EXTENSION
from lightwell.asset.records import FieldEntry as FieldEntry
from lightwell.asset.write import glb_bytes as glb_bytes
from lightwell.asset.write import write_glb as write_glb
