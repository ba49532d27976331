"""Puts the Basis Universal encoder of the npm package ktx2-encoder into the Python package.

npm pack ktx2-encoder@0.6.0 && tar xf ktx2-encoder-0.6.0.tgz && python tools/basis_encoder.py package
"""

from __future__ import annotations

import hashlib
import lzma
import sys
from pathlib import Path

from lightwell.basisu.codec import WASM_SHA256

OUT = Path(__file__).parents[1] / "lightwell/basisu"
NAMES = ("basis_encoder.js", "basis_encoder.wasm")


def main(package: Path, out: Path = OUT) -> None:
    """Compress the files of the encoder, after a check of their content.

    Args:
        package: Folder of the unpacked npm package.
        out: Folder to write to.

    Raises:
        SystemExit: The WebAssembly is not that of the version that ``codec.py`` names.
    """
    found = {name: (package / "dist/basis" / name).read_bytes() for name in NAMES}
    if hashlib.sha256(found["basis_encoder.wasm"]).hexdigest() != WASM_SHA256:
        sys.exit(f"basis_encoder: {package} is another version; change WASM_SHA256 in lightwell/basisu/codec.py too")
    for name, data in found.items():
        (out / f"{name}.xz").write_bytes(lzma.compress(data, preset=9 | lzma.PRESET_EXTREME))
    (out / "NOTICE.md").write_bytes((package / "THIRD_PARTY_NOTICES.md").read_bytes())


if __name__ == "__main__":
    main(Path(sys.argv[1]))
