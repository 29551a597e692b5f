// Two images side by side: matches as each filter leaves them, and the line of a point.
(function () {
  "use strict";
  if (!Series || Series.data.frames.length < 2) { return; }
  const { data, unpack, places, once, count } = Series;
  const byId = (id) => document.getElementById(id);
  const KEPT = "#3ddc84", DROPPED = "#f0524f", POINT = "#ffffff", FITTED = "#ffd54a";
  const MODEL = "#38bdf8", LAST_STEP = data.steps.length - 1, NEAR_PX = 1e-3;
  const sides = [byId("side-0"), byId("side-1")], selects = [byId("pair-0"), byId("pair-1")];
  const pairs = new Map(data.pairs.map((pair) => [pair.frames.join(" "), pair]));
  let point = null;
  let match = -1;

  const frames = () => selects.map((select) => Number(select.value));
  const wantedStep = () => Number(document.querySelector('#pair input[name="step"]:checked').value);

  // the pair of the two images shown, and whether the left one is its second
  function shown() {
    const [a, b] = frames();
    const pair = pairs.get(`${Math.min(a, b)} ${Math.max(a, b)}`) || null;
    return { pair, turned: a > b };
  }

  function matches() {
    const { pair, turned } = shown();
    if (!pair) { return null; }
    const found = once("pair " + pair.frames.join(" "), function () {
      return {
        xy: pair.xy.map((text, k) => places(text, data.frames[pair.frames[k]].size)),
        step: unpack(pair.step, Uint8Array)
      };
    });
    return { step: found.step, xy: turned ? [found.xy[1], found.xy[0]] : found.xy };
  }

  // a line u x + v y + w = 0 in the other image, of a point in image `side`
  function fittedLine(side, x, y) {
    const { pair, turned } = shown();
    if (!pair || !pair.n) { return null; }
    const [a, b, c, d, e] = pair.n;
    return (side === 0) !== turned ? [c, d, a * x + b * y + e] : [a, b, c * x + d * y + e];
  }

  function modelLine(side, x, y) {
    const [from, to] = [frames()[side], frames()[1 - side]].map((k) => data.frames[k].camera);
    if (!from || !to) { return null; }
    const [p, q] = [from.slice(0, 6), to.slice(0, 6)], toward = from.slice(8, 11);
    // pinv(P) r = P^T (P P^T)^-1 r
    const r = [x - from[6], y - from[7]];
    const dot = (m, i, n, j) => m[i] * n[j] + m[i + 1] * n[j + 1] + m[i + 2] * n[j + 2];
    const g = [dot(p, 0, p, 0), dot(p, 0, p, 3), dot(p, 3, p, 3)];
    const det = g[0] * g[2] - g[1] * g[1];
    const s = [(g[2] * r[0] - g[1] * r[1]) / det, (g[0] * r[1] - g[1] * r[0]) / det];
    const X = [0, 1, 2].map((k) => p[k] * s[0] + p[k + 3] * s[1]);
    const at = [0, 3].map((k, n) => dot(q, k, X, 0) + to[6 + n]);
    const along = [0, 3].map((k) => dot(q, k, toward, 0));
    if (Math.hypot(along[0], along[1]) < 1e-9 * Math.sqrt(g[0])) { return null; }
    return [along[1], -along[0], along[0] * at[1] - along[1] * at[0]];
  }

  function place(side) {
    const outer = byId("sides").getBoundingClientRect();
    const box = sides[side].getBoundingClientRect();
    const size = data.frames[frames()[side]].size;
    return {
      left: box.left - outer.left, top: box.top - outer.top, width: box.width, height: box.height,
      scale: box.width / size[0], size
    };
  }

  function drawLine(pen, box, line, color, dashes) {
    const [u, v, w] = line, ends = [];
    const [width, height] = box.size;
    if (Math.abs(v) > 1e-12) {
      for (const x of [0, width]) { ends.push([x, -(u * x + w) / v]); }
    }
    if (Math.abs(u) > 1e-12) {
      for (const y of [0, height]) { ends.push([-(v * y + w) / u, y]); }
    }
    const inside = ends.filter(([x, y]) =>
      x >= -NEAR_PX && x <= width + NEAR_PX && y >= -NEAR_PX && y <= height + NEAR_PX);
    if (inside.length < 2) { return; }
    inside.sort((p, q) => p[0] - q[0] || p[1] - q[1]);
    const [first, last] = [inside[0], inside[inside.length - 1]];
    pen.strokeStyle = color;
    pen.lineWidth = 1.6;
    pen.setLineDash(dashes);
    pen.beginPath();
    pen.moveTo(box.left + first[0] * box.scale, box.top + first[1] * box.scale);
    pen.lineTo(box.left + last[0] * box.scale, box.top + last[1] * box.scale);
    pen.stroke();
    pen.setLineDash([]);
  }

  function drawCross(pen, box, x, y, color) {
    const u = box.left + x * box.scale, v = box.top + y * box.scale;
    pen.strokeStyle = color;
    pen.lineWidth = 1.6;
    pen.beginPath();
    pen.moveTo(u - 9, v); pen.lineTo(u + 9, v);
    pen.moveTo(u, v - 9); pen.lineTo(u, v + 9);
    pen.stroke();
  }

  function drawMatches(pen, boxes) {
    const found = matches();
    if (!found) { return; }
    const step = wantedStep();
    pen.lineWidth = 0.8;
    for (const kept of [false, true]) {
      if (!kept && !byId("pair-dropped").checked) { continue; }
      pen.strokeStyle = pen.fillStyle = kept ? KEPT : DROPPED;
      for (let j = 0; j < found.step.length; j++) {
        if (kept ? found.step[j] <= step : found.step[j] !== step) { continue; }
        const at = boxes.map((box, k) => [
          box.left + found.xy[k][2 * j] * box.scale, box.top + found.xy[k][2 * j + 1] * box.scale]);
        if (byId("pair-lines").checked) {
          pen.globalAlpha = point ? 0.12 : 0.45;
          pen.beginPath(); pen.moveTo(...at[0]); pen.lineTo(...at[1]); pen.stroke();
          pen.globalAlpha = 1;
        }
        for (const [u, v] of at) { pen.beginPath(); pen.arc(u, v, 1.8, 0, 7); pen.fill(); }
      }
    }
  }

  const offLine = ([u, v, w], x, y) => Math.abs(u * x + v * y + w) / Math.hypot(u, v);

  // the drawn verified match nearest to the point, and how far its other end is from the lines
  function nearestMatch() {
    const found = matches();
    if (!found || !point) { return null; }
    let best = null;
    for (let j = 0; j < found.step.length; j++) {
      if (found.step[j] !== LAST_STEP) { continue; }
      const [here, there] = [found.xy[point.side], found.xy[1 - point.side]];
      const away = Math.hypot(here[2 * j] - point.x, here[2 * j + 1] - point.y);
      if (!best || away < best.away) {
        best = { away, x: here[2 * j], y: here[2 * j + 1], u: there[2 * j], v: there[2 * j + 1] };
      }
    }
    return best;
  }

  function draw() {
    const outer = byId("sides");
    if (outer.clientWidth === 0) { return; }
    const pen = Series.context(byId("pair-overlay"), outer.clientWidth, outer.clientHeight);
    const boxes = [place(0), place(1)];
    drawMatches(pen, boxes);
    if (point) {
      const other = boxes[1 - point.side];
      const model = modelLine(point.side, point.x, point.y);
      const fitted = fittedLine(point.side, point.x, point.y);
      if (fitted) { drawLine(pen, other, fitted, FITTED, []); }
      if (model) { drawLine(pen, other, model, MODEL, [7, 5]); }
      drawCross(pen, boxes[point.side], point.x, point.y, POINT);
      const near = nearestMatch();
      if (near && near.away < NEAR_PX) {
        pen.strokeStyle = POINT;
        pen.beginPath();
        pen.arc(other.left + near.u * other.scale, other.top + near.v * other.scale, 6, 0, 7);
        pen.stroke();
      }
    }
    say();
  }

  function say() {
    const { pair } = shown(), facts = [];
    const total = pair ? pair.counts.reduce((sum, n) => sum + n, 0) : 0;
    if (!pair) {
      facts.push("This pair was not matched; lines are those of the model's cameras.");
    } else {
      facts.push(`${count(pair.counts[LAST_STEP])} of ${count(total)} matches verified` +
        (pair.num < total ? `, ${count(pair.num)} drawn.` : "."));
      if (!pair.known) { facts.push("Which filter dropped a match was not recorded."); }
    }
    if (point) {
      const fitted = fittedLine(point.side, point.x, point.y);
      const model = modelLine(point.side, point.x, point.y);
      facts.push(`Point (${point.x.toFixed(1)}, ${point.y.toFixed(1)}) px in the ` +
        `${point.side === 0 ? "left" : "right"} image.`);
      if (fitted) { facts.push("Yellow: its line by the verified matches."); }
      if (model) { facts.push("Blue, dashed: by the cameras of the model."); }
      if (!fitted && !model) { facts.push("No geometry of this pair is known."); }
      const near = nearestMatch();
      if (near && near.away < NEAR_PX) {
        const off = [[fitted, "the matches' line"], [model, "the model's"]].filter(([l]) => l)
          .map(([line, name]) => `${offLine(line, near.u, near.v).toFixed(2)} px from ${name}`);
        facts.push(`The match (ring) lies ${off.join(", ")}.`);
      }
    }
    byId("pair-facts").textContent = facts.join(" ");
  }

  function showCounts() {
    const { pair } = shown();
    document.querySelectorAll("#pair [data-step]").forEach(function (span) {
      const step = Number(span.dataset.step);
      span.textContent = !pair ? "" : count(
        pair.counts.reduce((sum, n, k) => sum + (k > step ? n : 0), 0));
    });
    document.querySelectorAll('#pair input[name="step"]').forEach(function (box) {
      box.disabled = Boolean(pair) && !pair.known && (box.value === "0" || box.value === "1");
      if (box.disabled && box.checked) {
        document.querySelector('#pair input[name="step"][value="2"]').checked = true;
      }
    });
  }

  function load() {
    point = null;
    match = -1;
    frames().forEach(function (k, side) {
      const frame = data.frames[k], img = sides[side].querySelector("img");
      if (frame.picture) { img.src = frame.picture; } else { img.removeAttribute("src"); }
      img.alt = `Frame ${frame.number}, ${frame.name}`;
      sides[side].style.aspectRatio = `${frame.size[0]} / ${frame.size[1]}`;
    });
    const [a, b] = frames();
    byId("pair-title").textContent = `Frames ${a + 1} and ${b + 1}`;
    showCounts();
    draw();
  }

  function choose(a, b) {
    selects[0].value = String(a);
    selects[1].value = String(b);
    load();
  }

  function step(by) {
    const { pair } = shown();
    const now = pair ? data.pairs.indexOf(pair) : by > 0 ? -1 : 0;
    const num = data.pairs.length;
    if (num) { choose(...data.pairs[(now + by + num) % num].frames); }
  }

  function nextMatch() {
    const found = matches();
    if (!found) { return; }
    for (let n = 0; n < found.step.length; n++) {
      match = (match + 1) % found.step.length;
      if (found.step[match] === LAST_STEP) {
        point = { side: 0, x: found.xy[0][2 * match], y: found.xy[0][2 * match + 1] };
        draw();
        return;
      }
    }
  }

  function moveBy(side, dx, dy) {
    const [width, height] = data.frames[frames()[side]].size;
    if (!point || point.side !== side) { point = { side, x: width / 2, y: height / 2 }; }
    point.x = Math.min(Math.max(point.x + dx, 0), width);
    point.y = Math.min(Math.max(point.y + dy, 0), height);
    draw();
  }

  data.frames.forEach(function (frame, k) {
    for (const select of selects) {
      select.add(new Option(`${frame.number}: ${frame.name}`, String(k)));
    }
  });
  selects.forEach((select) => select.addEventListener("change", load));
  sides.forEach(function (side, k) {
    side.addEventListener("click", function (event) {
      const box = side.getBoundingClientRect(), size = data.frames[frames()[k]].size;
      point = {
        side: k, x: (event.clientX - box.left) / box.width * size[0],
        y: (event.clientY - box.top) / box.height * size[1]
      };
      draw();
    });
    side.addEventListener("keydown", function (event) {
      const by = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[
        event.key];
      if (!by) { return; }
      event.preventDefault();
      const far = event.shiftKey ? 1 : data.frames[frames()[k]].size[0] / 50;
      moveBy(k, far * by[0], far * by[1]);
    });
  });
  byId("pair-before").addEventListener("click", () => step(-1));
  byId("pair-after").addEventListener("click", () => step(1));
  byId("next-match").addEventListener("click", nextMatch);
  document.querySelectorAll('#pair input').forEach((box) => box.addEventListener("input", draw));
  byId("pair").hidden = false;
  new ResizeObserver(draw).observe(byId("sides"));
  // the pair of neighbours in the middle of the series says most at first
  const middle = data.pairs.filter((pair) => pair.frames[1] - pair.frames[0] === 1);
  const best = middle[Math.floor(middle.length / 2)] || data.pairs[0];
  if (best) { choose(...best.frames); } else { choose(0, 1); }
})();
