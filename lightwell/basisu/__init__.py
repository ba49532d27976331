"""GPU-compressed pictures: the Basis Universal encoder and decoder, in KTX 2.0 files."""

from lightwell.basisu.codec import BLOCK as BLOCK
from lightwell.basisu.codec import CODECS as CODECS
from lightwell.basisu.codec import HEADER_BYTES as HEADER_BYTES
from lightwell.basisu.codec import block_bytes as block_bytes
from lightwell.basisu.codec import decode as decode
from lightwell.basisu.codec import decode_with_alpha as decode_with_alpha
from lightwell.basisu.codec import encode as encode
from lightwell.basisu.codec import is_ktx2 as is_ktx2
from lightwell.basisu.codec import missing as missing
from lightwell.basisu.codec import size as size
