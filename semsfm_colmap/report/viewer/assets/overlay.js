// What is written over the picture: scale bar, axes, legend, numbers of frames, measured places.
// Drawn on a canvas of its own, so that an exported picture shows the same.
(function () {
  "use strict";
  const semsfm = (window.semsfm = window.semsfm || {});
  const PAD = 12, FONT = 13, BAR_SHARE = 0.28, AXES_PX = 30;
  const AXES = [["x", "#d1495b"], ["y", "#3c9d5d"], ["z", "#3f7fd0"]];
  const LEGEND = { width: 14, height: 120 };

  function text(g, words, x, y, align, color) {
    g.textAlign = align;
    g.lineWidth = 4;
    g.lineJoin = "round";
    g.strokeStyle = g.ground;
    g.strokeText(words, x, y);
    g.fillStyle = color || g.ink;
    g.fillText(words, x, y);
  }

  function scaleBar(g, view) {
    const length = semsfm.roundLength(BAR_SHARE * view.width * view.unitsPerPx);
    const px = length / view.unitsPerPx, x = PAD, y = view.height - PAD;
    g.lineWidth = 6;
    g.strokeStyle = g.ground;
    const line = () => {
      g.beginPath();
      g.moveTo(x, y - 6); g.lineTo(x, y); g.lineTo(x + px, y); g.lineTo(x + px, y - 6);
      g.stroke();
    };
    line();
    g.lineWidth = 2;
    g.strokeStyle = g.ink;
    line();
    const words = semsfm.number(length, 1) + " " + view.unit;
    text(g, words, x + px / 2, y - 8, "center");
    return { length, px, words };
  }

  function axes(g, view) {
    const x0 = view.width - PAD - AXES_PX - 10, y0 = view.height - PAD - AXES_PX - 10;
    AXES.map(([name, color], k) => ({ name, color, d: view.direction(k) }))
      .sort((a, b) => a.d[2] - b.d[2])
      .forEach(({ name, color, d }) => {
        const x = x0 + AXES_PX * d[0], y = y0 - AXES_PX * d[1];
        g.lineWidth = 2;
        g.strokeStyle = color;
        g.beginPath(); g.moveTo(x0, y0); g.lineTo(x, y); g.stroke();
        text(g, name, x + 8 * d[0], y - 8 * d[1] + 4, "center", color);
      });
  }

  function legend(g, view, found) {
    if (!found) { return; }
    const right = view.width - PAD;
    let y = PAD + FONT;
    text(g, found.title + (found.unit ? ", " + found.unit : ""), right, y, "right");
    y += 10;
    if (found.parts) {
      for (const part of found.parts) {
        g.fillStyle = "rgb(" + part.color.join(",") + ")";
        g.fillRect(right - LEGEND.width, y, LEGEND.width, LEGEND.width);
        text(g, part.name, right - LEGEND.width - 6, y + LEGEND.width - 3, "right");
        y += LEGEND.width + 6;
      }
      return;
    }
    const height = Math.min(LEGEND.height, 0.4 * view.height);
    for (let k = 0; k < height; k++) {
      g.fillStyle = "rgb(" + found.map(1 - k / (height - 1)).join(",") + ")";
      g.fillRect(right - LEGEND.width, y + k, LEGEND.width, 1.5);
    }
    const ticks = [[found.high, 0, found.clipped[1] ? "≥ " : ""], [(found.low + found.high) / 2, 0.5, ""],
      [found.low, 1, found.clipped[0] ? "≤ " : ""]];
    for (const [value, share, sign] of ticks) {
      text(g, sign + semsfm.number(value, 3), right - LEGEND.width - 6, y + share * height + 4, "right");
    }
  }

  function frameNumbers(g, view, frames) {
    for (const frame of frames) {
      const p = view.project(frame.point);
      text(g, frame.words, p[0], p[1] - 4, "center");
    }
  }

  function places(g, view, marks) {
    const points = marks.map((mark) => view.project(mark.point));
    g.lineWidth = 2;
    g.strokeStyle = g.accent;
    g.beginPath();
    points.forEach((p, k) => (k ? g.lineTo(p[0], p[1]) : g.moveTo(p[0], p[1])));
    g.stroke();
    points.forEach((p, k) => {
      g.beginPath(); g.arc(p[0], p[1], 5, 0, 2 * Math.PI);
      g.lineWidth = 2;
      g.strokeStyle = g.accent;
      g.fillStyle = g.ground;
      g.fill();
      g.stroke();
      text(g, "ABC"[k], p[0] + 9, p[1] - 7, "left", g.accent);
    });
  }

  function crosshair(g, view) {
    const x = view.width / 2, y = view.height / 2;
    g.lineWidth = 1.5;
    g.strokeStyle = g.accent;
    g.beginPath();
    for (const [a, b] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      g.moveTo(x + 5 * a, y + 5 * b); g.lineTo(x + 14 * a, y + 14 * b);
    }
    g.stroke();
  }

  // view: width, height in px, unitsPerPx, unit, project(point), direction(axis), colors
  semsfm.drawOverlay = function (canvas, view, what, ratio) {
    const g = canvas.getContext("2d");
    g.setTransform(ratio, 0, 0, ratio, 0, 0);
    if (!what.over) { g.clearRect(0, 0, view.width, view.height); }
    g.font = FONT + "px system-ui, sans-serif";
    Object.assign(g, { ink: view.colors.ink, ground: view.colors.ground, accent: view.colors.accent });
    frameNumbers(g, view, what.frames);
    places(g, view, what.places);
    legend(g, view, what.legend);
    axes(g, view);
    if (what.crosshair) { crosshair(g, view); }
    return scaleBar(g, view);
  };
})();
