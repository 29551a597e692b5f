// The packed scene (packing.py): header and typed arrays.
(function () {
  "use strict";
  const semsfm = (window.semsfm = window.semsfm || {});
  const MAGIC = "SEMSFM3D";
  const TYPES = {
    u1: Uint8Array, i1: Int8Array, u2: Uint16Array, i2: Int16Array,
    u4: Uint32Array, i4: Int32Array, f4: Float32Array
  };

  semsfm.unpack = function (buffer) {
    const view = new DataView(buffer);
    const magic = String.fromCharCode(...new Uint8Array(buffer, 0, MAGIC.length));
    if (magic !== MAGIC) { throw new Error("these bytes are no packed scene"); }
    const size = view.getUint32(MAGIC.length, true);
    const start = MAGIC.length + 4 + size;
    const text = new TextDecoder().decode(new Uint8Array(buffer, MAGIC.length + 4, size));
    const header = JSON.parse(text);
    const arrays = {};
    for (const [name, entry] of Object.entries(header.arrays)) {
      const count = entry.shape.reduce((a, b) => a * b, 1);
      arrays[name] = new TYPES[entry.type](buffer, start + entry.at, count);
      arrays[name].shape = entry.shape;
    }
    return { header, arrays };
  };

  // base64 of gzip, as a page holds it
  semsfm.decompress = function (text) {
    const packed = atob(text.trim());
    const bytes = new Uint8Array(packed.length);
    for (let k = 0; k < bytes.length; k++) { bytes[k] = packed.charCodeAt(k); }
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).arrayBuffer();
  };
})();
