// The packed numbers of the images (semsfm_colmap/report/images/packed.py), unpacked when asked for.
const Series = (function () {
  "use strict";
  const source = document.getElementById("series-data");
  if (!source) { return null; }
  const data = JSON.parse(source.textContent);
  const kept = new Map();

  function bytes(text) {
    const raw = atob(text), values = new Uint8Array(raw.length);
    for (let k = 0; k < raw.length; k++) { values[k] = raw.charCodeAt(k); }
    return values;
  }

  // browsers run on little-endian machines only, and so are the numbers
  function unpack(text, Kind) { return new Kind(bytes(text).buffer); }

  function places(text, size) {
    const fraction = unpack(text, Uint16Array), xy = new Float32Array(fraction.length);
    for (let k = 0; k < xy.length; k++) { xy[k] = fraction[k] / 65535 * size[k % 2]; }
    return xy;
  }

  function once(key, make) {
    if (!kept.has(key)) { kept.set(key, make()); }
    return kept.get(key);
  }

  function count(value) { return value.toLocaleString("en").replace(/,/g, "\u2009"); }

  // a canvas as fine as the screen, whose units are CSS pixels
  function context(canvas, width, height) {
    const fine = window.devicePixelRatio || 1;
    canvas.width = Math.round(width * fine);
    canvas.height = Math.round(height * fine);
    const pen = canvas.getContext("2d");
    pen.setTransform(fine, 0, 0, fine, 0, 0);
    pen.clearRect(0, 0, width, height);
    return pen;
  }

  return { data, unpack, places, once, count, context };
})();
