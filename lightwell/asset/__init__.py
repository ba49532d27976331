"""The baked asset: a glTF 2.0 file with learned light, written, read, and put into a page of its own."""

from lightwell.asset.info import info as info
from lightwell.asset.page import PageView as PageView
from lightwell.asset.page import write_page as write_page
from lightwell.asset.read import read_fields as read_fields
from lightwell.asset.records import EXTENSION as EXTENSION
from lightwell.asset.records import FieldEntry as FieldEntry
from lightwell.asset.write import glb_bytes as glb_bytes
from lightwell.asset.write import write_glb as write_glb
