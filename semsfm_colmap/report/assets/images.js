// The panel of one image: pictures below, keypoints, residuals and tracks drawn over them.
(function () {
  "use strict";
  if (!Series) { return; }
  const { data, unpack, places, once, count } = Series;
  const byId = (id) => document.getElementById(id);
  const COLORS = ["#9aa7b5", "#e8a33d", "#b58cf0", "#f0524f", "#3ddc84", "#38bdf8"];
  const KEPT = 4, EARLIER = "#5aa9ff", LATER = "#ff9d3c", VECTOR = "#ffd54a";
  const MAGNIFICATION = 50, BLINK_MS = 600;
  const buttons = Array.from(document.querySelectorAll("#strip button"));
  const canvas = byId("overlay"), second = byId("second"), base = byId("base");
  let current = 0, blinking = null;

  const checked = (name) => Array.from(
    document.querySelectorAll(`#panel input[name="${name}"]:checked`), (box) => box.value);
  const picture = () => checked("picture")[0];

  function keypoints(k) {
    return once("keypoints " + k, function () {
      const packed = data.frames[k].keypoints;
      return packed && {
        xy: places(packed.xy, data.frames[k].size),
        shape: unpack(packed.shape, Uint8Array),
        fate: unpack(packed.fate, Uint8Array)
      };
    });
  }

  function drawMark(pen, fate, x, y, r) {
    pen.beginPath();
    if (fate === 1 || fate === 3) {
      pen.moveTo(x - r, y - r); pen.lineTo(x + r, y + r);
      pen.moveTo(x - r, y + r); pen.lineTo(x + r, y - r);
      pen.stroke();
    } else if (fate === 2) {
      pen.rect(x - r, y - r, 2 * r, 2 * r); pen.stroke();
    } else {
      pen.arc(x, y, fate === 0 ? 0.7 * r : r, 0, 7);
      if (fate < KEPT) { pen.fill(); } else { pen.stroke(); }
    }
  }

  function drawRegion(pen, shape, j, x, y, scale) {
    if (shape[4 * j] === 0) { return; }
    const longer = scale * data.code.smallest * Math.pow(data.code.scale, shape[4 * j] - 1);
    const shorter = longer * shape[4 * j + 1] / 255;
    const turn = shape[4 * j + 3] * Math.PI / 128;
    pen.beginPath();
    pen.ellipse(x, y, longer, shorter, shape[4 * j + 2] * Math.PI / 256, 0, 7);
    pen.moveTo(x, y);
    pen.lineTo(x + longer * Math.cos(turn), y + longer * Math.sin(turn));
    pen.stroke();
  }

  function drawKeypoints(pen, k, scale, regions) {
    const points = keypoints(k);
    if (!points) { return; }
    const wanted = new Set(checked("fate").map(Number));
    const radius = Math.max(0.9, Math.min(3, 2 * scale));
    pen.lineWidth = 1.1;
    for (let j = 0; j < points.fate.length; j++) {
      const fate = points.fate[j];
      if (!wanted.has(fate)) { continue; }
      pen.strokeStyle = pen.fillStyle = COLORS[fate];
      const x = points.xy[2 * j] * scale, y = points.xy[2 * j + 1] * scale;
      if (regions) { drawRegion(pen, points.shape, j, x, y, scale); }
      if (!regions || points.shape[4 * j] === 0) { drawMark(pen, fate, x, y, radius); }
    }
  }

  function drawResiduals(pen, k, scale) {
    const packed = data.frames[k].residuals;
    if (!packed) { return; }
    const xy = places(packed.xy, data.frames[k].size), d = unpack(packed.d, Int16Array);
    const stretch = MAGNIFICATION * data.code.residual * scale;
    pen.strokeStyle = pen.fillStyle = VECTOR;
    pen.lineWidth = 1.2;
    for (let j = 0; j < d.length; j += 2) {
      const x = xy[j] * scale, y = xy[j + 1] * scale;
      pen.beginPath();
      pen.moveTo(x, y); pen.lineTo(x + stretch * d[j], y + stretch * d[j + 1]);
      pen.stroke();
      pen.beginPath(); pen.arc(x, y, 1.5, 0, 7); pen.fill();
    }
  }

  const tracks = () => once("tracks", function () {
    return {
      lengths: unpack(data.tracks.lengths, Uint16Array),
      frame: unpack(data.tracks.frame, Uint16Array),
      xy: places(data.tracks.xy, [1, 1])
    };
  });

  function drawTracks(pen, k, scale) {
    const { lengths, frame, xy } = tracks();
    const [width, height] = data.frames[k].size;
    const reach = Math.max(1, Number(byId("reach").value) || 1);
    pen.lineWidth = 1.1;
    let begin = 0;
    for (const length of lengths) {
      const rows = [];
      let here = -1;
      for (let r = begin; r < begin + length; r++) {
        if (Math.abs(frame[r] - k) <= reach) { rows.push(r); }
        if (frame[r] === k) { here = r; }
      }
      begin += length;
      if (here < 0) { continue; }
      const x = (r) => xy[2 * r] * width * scale, y = (r) => xy[2 * r + 1] * height * scale;
      for (let m = 1; m < rows.length; m++) {
        pen.strokeStyle = frame[rows[m]] <= k ? EARLIER : LATER;
        pen.beginPath();
        pen.moveTo(x(rows[m - 1]), y(rows[m - 1])); pen.lineTo(x(rows[m]), y(rows[m]));
        pen.stroke();
      }
      pen.fillStyle = "#ffffff";
      pen.beginPath(); pen.arc(x(here), y(here), 1.4, 0, 7); pen.fill();
    }
  }

  function draw() {
    const frame = data.frames[current], width = byId("stack").clientWidth;
    if (width === 0) { return; }
    const scale = width / frame.size[0];
    const pen = Series.context(canvas, width, frame.size[1] * scale);
    const over = new Set(checked("over"));
    if (over.has("tracks")) { drawTracks(pen, current, scale); }
    if (over.has("keypoints") || over.has("regions")) {
      drawKeypoints(pen, current, scale, over.has("regions"));
    }
    if (over.has("residuals")) { drawResiduals(pen, current, scale); }
    say(over);
  }

  function say(over) {
    const frame = data.frames[current], parts = [];
    const points = frame.keypoints, vectors = frame.residuals;
    if (points && (over.has("keypoints") || over.has("regions"))) {
      if (points.num < points.total) {
        parts.push(`${count(points.num)} of ${count(points.total)} keypoints are drawn.`);
      }
      if (over.has("regions")) {
        parts.push("Regions as in the paper's figure 3: an ellipse of the keypoint's scale and a " +
          "line in its orientation; what the guided pass found has none.");
      }
    }
    if (over.has("residuals")) {
      parts.push(!vectors ? "The image is not registered: it has no residuals."
        : `Residuals, predicted minus measured, ${MAGNIFICATION} times longer than they are, of ` +
          `${count(vectors.num)} of ${count(vectors.total)} kept observations; the dot is the ` +
          "measured place.");
    }
    if (over.has("tracks")) {
      parts.push("Tracks as in the paper's figure 5: from earlier frames in blue, to later ones in " +
        `orange; of the ${count(data.tracks.num)} longest of ${count(data.tracks.total)} tracks.`);
    }
    byId("panel-hint").textContent = parts.join(" ");
    const counts = points ? points.counts : [];
    const named = data.fates.map((label, fate) => `${label}: ${counts[fate] || 0}`).join(", ");
    canvas.setAttribute("aria-label", `Drawn over frame ${frame.number}: ` +
      (over.size ? Array.from(over).join(", ") : "nothing") + `. Keypoints by fate: ${named}.`);
  }

  function showPicture() {
    const frame = data.frames[current];
    document.querySelectorAll('#panel input[name="picture"]').forEach(function (box) {
      box.disabled = box.value !== "image" && !frame[box.value];
      if (box.disabled && box.checked) {
        document.querySelector('#panel input[value="image"]').checked = true;
      }
    });
    const kind = picture(), entry = frame[kind], map = kind === "depth" || kind === "sigma";
    second.hidden = kind === "image";
    byId("wipe").disabled = byId("blink").disabled = kind === "image";
    if (kind === "image") { stopBlinking(); }
    if (!second.hidden) {
      second.src = map ? entry.picture : entry;
      second.alt = { mesh: "The mesh as this camera sees it", depth: "Depth map in colours",
        sigma: "Standard deviation of the depth in colours" }[kind];
      second.classList.toggle("pixelated", map);
    }
    byId("color-bar").hidden = !map;
    if (map) {
      const digits = (value) => Number(value.toPrecision(3)).toString().replace("-", "\u2212");
      byId("colors").style.background = `linear-gradient(to right, ${data.colors[kind]})`;
      byId("color-low").textContent = digits(entry.low);
      byId("color-high").textContent = digits(entry.high) + " " + data.unit +
        (kind === "depth" ? " along the view, away from the viewer" : " (1 \u03c3)");
    }
    wipe();
  }

  function wipe() {
    second.style.clipPath = `inset(0 ${100 - Number(byId("wipe").value)}% 0 0)`;
  }

  function stopBlinking() {
    clearInterval(blinking);
    blinking = null;
    second.style.visibility = "";
    byId("blink").setAttribute("aria-pressed", "false");
  }

  function show(k) {
    current = (k + data.frames.length) % data.frames.length;
    const frame = data.frames[current], points = frame.keypoints;
    buttons.forEach((button, j) => button.setAttribute("aria-pressed", String(j === current)));
    byId("panel-title").textContent = `Frame ${frame.number}: ${frame.name}`;
    const facts = [`${frame.size[0]} \u00d7 ${frame.size[1]} px`];
    if (points) { facts.push(`${count(points.total - points.counts[5])} keypoints measured`); }
    facts.push(frame.residuals ? `${count(frame.residuals.total)} observations kept`
      : "not registered: it has no pose");
    byId("panel-facts").textContent = facts.join(", ") + ".";
    document.querySelectorAll("#panel [data-fate]").forEach(function (span) {
      span.textContent = points ? count(points.counts[Number(span.dataset.fate)]) : "";
    });
    base.hidden = !frame.picture;
    if (frame.picture) { base.src = frame.picture; }
    base.alt = `Frame ${frame.number}, ${frame.name}`;
    byId("stack").style.aspectRatio = `${frame.size[0]} / ${frame.size[1]}`;
    showPicture();
    draw();
  }

  document.querySelectorAll("#panel .mark").forEach(function (mark, fate) {
    mark.style.background = COLORS[fate];
  });
  buttons.forEach((button, k) => button.addEventListener("click", () => show(k)));
  byId("before").addEventListener("click", () => show(current - 1));
  byId("after").addEventListener("click", () => show(current + 1));
  byId("zoom").addEventListener("change", function (event) {
    byId("stack").style.width = `${100 * Number(event.target.value)}%`;
  });
  byId("wipe").addEventListener("input", wipe);
  byId("blink").addEventListener("click", function () {
    if (blinking !== null) { stopBlinking(); return; }
    byId("blink").setAttribute("aria-pressed", "true");
    blinking = setInterval(function () {
      second.style.visibility = second.style.visibility === "hidden" ? "" : "hidden";
    }, BLINK_MS);
  });
  document.querySelectorAll('#panel input[name="picture"]').forEach((box) =>
    box.addEventListener("change", function () {
      byId("wipe").value = box.value === "mesh" ? "50" : "100";
      showPicture();
    }));
  document.querySelectorAll('#panel input[name="over"], #panel input[name="fate"], #reach')
    .forEach((box) => box.addEventListener("input", draw));
  byId("without-script").hidden = true;
  byId("panel").hidden = false;
  new ResizeObserver(draw).observe(byId("stack"));
  show(0);
})();
