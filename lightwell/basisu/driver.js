// What Emscripten's output asks a page for. The encoder runs in V8 alone, without a page and without a clock.
globalThis.self = globalThis.window = globalThis;
globalThis.location = { href: "" };
globalThis.document = { currentScript: null };
globalThis.performance = { now: () => 0 };

/** Bytes under a name, which the caller fills or reads. */
function bytes(name, size) {
  globalThis[name] = new Uint8Array(size);
  return globalThis[name].buffer;
}

/** Start the module, whose WebAssembly is in the bytes `wasm`. */
function start() {
  const quiet = { print: () => {}, printErr: () => {} };
  return BASIS({ wasmBinary: wasm, locateFile: (name) => name, ...quiet }).then((module) => {
    module.initializeBasis();
    globalThis.basis = module;
    return true;
  });
}

/** Encode RGBA texels, the bytes `texels`, into a KTX2 file, the bytes `file`. Returns its size, 0 when the encoder refuses. */
function encode(width, height, uastc, effort, mips) {
  const encoder = new basis.BasisEncoder();
  try {
    encoder.setCreateKTX2File(true);
    encoder.setUASTC(uastc);
    // Numbers, not colours: no transfer function, and an error counts the same in each channel.
    encoder.setKTX2AndBasisSRGBTransferFunc(false);
    encoder.setPerceptual(false);
    encoder.setMipSRGB(false);
    encoder.setMipGen(mips > 0);
    encoder.setMipFilter("box");
    encoder.setMipWrapping(false);
    encoder.setMipSmallestDimension(Math.max(Math.max(width, height) >> mips, 1));
    if (uastc) {
      encoder.setPackUASTCFlags(effort);
      encoder.setKTX2UASTCSupercompression(true);
    } else {
      encoder.setETC1SCompressionLevel(effort);
      encoder.setQualityLevel(255);
    }
    if (!encoder.setSliceSourceImage(0, texels, width, height, 0)) return 0;
    const room = new Uint8Array(8 * width * height + 65536);
    globalThis.file = room.slice(0, encoder.encode(room));
    return file.length;
  } finally {
    encoder.delete();
  }
}

/** Decode a level of a KTX2 file, the bytes `file`, to RGBA texels, the bytes `texels`. Returns [width, height], or what is wrong. */
function decode(level) {
  const opened = new basis.KTX2File(file);
  try {
    if (!opened.isValid()) return "it is no KTX2 file of Basis Universal";
    if (opened.isHDR()) return "its texels are floats, expected bytes";
    if (level >= opened.getLevels()) return `it has ${opened.getLevels()} mip levels, and level ${level} is read`;
    if (!opened.startTranscoding()) return "its blocks cannot be read";
    const format = basis.transcoder_texture_format.cTFRGBA32.value;
    globalThis.texels = new Uint8Array(opened.getImageTranscodedSizeInBytes(level, 0, 0, format));
    if (!opened.transcodeImage(texels, level, 0, 0, format, 0, -1, -1)) return "its blocks cannot be decoded";
    const { origWidth, origHeight } = opened.getImageLevelInfo(level, 0, 0);
    return `${origWidth} ${origHeight}`;
  } finally {
    opened.close();
    opened.delete();
  }
}
