"""EXR files from untrusted sources: the header is checked in this process, the pixels are decoded in a separate one.

from lightwell.exr import decode_parts, read_header
parts = read_header(path, Limits().budget(f"lens: {path}"))
pixels = decode_parts(path, parts, range(len(parts)), seconds=60)
"""

from lightwell.exr.chunks import read_header as read_header
from lightwell.exr.decoding import DecodedPart as DecodedPart
from lightwell.exr.decoding import decode_parts as decode_parts
from lightwell.exr.header import ExrError as ExrError
from lightwell.exr.header import ExrPart as ExrPart
