"""EXR files from anywhere: the header is checked here, the pixels are decoded in a process of their own.

from lightwell.exr import read_parts
parts = read_parts(path, Limits().budget(f"lens: {path}"))
"""

from lightwell.exr.chunks import read_header as read_header
from lightwell.exr.decoding import DecodedPart as DecodedPart
from lightwell.exr.decoding import decode_parts as decode_parts
from lightwell.exr.header import ExrError as ExrError
from lightwell.exr.header import Part as Part
