// Places picked on the surface, and what is read from them.
(function () {
  "use strict";
  const semsfm = (window.semsfm = window.semsfm || {});
  const SNAP_PX = 40, SNAP_RADII = 0.05;

  semsfm.element = function (name, attributes, ...children) {
    const out = document.createElement(name);
    Object.entries(attributes || {}).forEach(([key, value]) => out.setAttribute(key, value));
    out.append(...children);
    return out;
  };
  const element = semsfm.element;

  // state: scene, drawing, navigation, places; live: a server measures; part: elements by name
  semsfm.measuring = function ({ state, live, part, canvas, say, invalidate }) {
    function placeNumber(k) {
      const { arrays, header } = state.scene;
      const drawn = Array.from(arrays["place.position"].subarray(3 * k, 3 * k + 3));
      const n = Array.from(arrays["place.normal"].subarray(3 * k, 3 * k + 3));
      const size = Math.hypot(...n) || 1;
      const seen = arrays["place.seen"], bytes = seen ? seen.shape[1] : 0;
      return {
        id: arrays["place.id"][k], drawn, point: drawn.map((x, j) => x + header.origin[j]),
        normal: n.map((x) => x / size), sigma: arrays["place.sigma"] ? arrays["place.sigma"][k] : NaN,
        seen: seen ? seen.subarray(bytes * k, bytes * k + bytes) : null
      };
    }

    // the vertex nearest to a point of the surface
    function nearest(point) {
      const p = state.scene.arrays["place.position"];
      let best = 0, least = Infinity;
      for (let k = 0; k < p.length; k += 3) {
        const d = (p[k] - point.x) ** 2 + (p[k + 1] - point.y) ** 2 + (p[k + 2] - point.z) ** 2;
        if (d < least) { least = d; best = k / 3; }
      }
      return { k: best, distance: Math.sqrt(least) };
    }

    function addPlace(place) {
      if (state.places.length === 3) { state.places = []; }
      if (state.places.some((other) => other.id === place.id)) {
        say("vertex " + place.id + " is already picked");
        return;
      }
      say("");
      state.places.push(place);
      show();
    }

    function addVertex(id) {
      const k = Array.prototype.indexOf.call(state.scene.arrays["place.id"], id);
      if (k < 0) {
        say(live ? "the mesh has no vertex " + id
          : "vertex " + id + " is not among those that this page holds: use semsfm view, or semsfm measure");
        return false;
      }
      addPlace(placeNumber(k));
      return true;
    }

    function pick(x, y) {
      const width = canvas.clientWidth, height = canvas.clientHeight;
      const raycaster = new THREE.Raycaster();
      raycaster.setFromCamera({ x: 2 * x / width - 1, y: 1 - 2 * y / height }, state.navigation.camera);
      const point = state.drawing.hit(raycaster);
      if (!point) { say("no surface there: show the mesh and pick a place on it"); return; }
      const found = nearest(point);
      const far = [SNAP_PX * state.navigation.unitsPerPx, SNAP_RADII * state.scene.header.radius];
      if (found.distance > Math.max(...far)) {
        say("no vertex of mesh.ply is near that place");
        return;
      }
      addPlace(placeNumber(found.k));
    }

    function command() {
      return "semsfm measure PROJECT --points " + state.places.map((p) => "vertex:" + p.id).join(" ");
    }

    async function show() {
      invalidate();
      const holder = part("readout"), asked = state.places.slice();
      state.results = null;
      if (!asked.length) { holder.replaceChildren(); return; }
      const named = asked.map((p, k) => "ABC"[k] + " vertex:" + p.id).join(", ");
      if (asked.length < 2) { holder.replaceChildren(element("p", {}, named + ". Pick a second place.")); return; }
      let results;
      if (live) {
        holder.replaceChildren(element("p", {}, named + " …"));
        try {
          const answer = await fetch("measure?vertices=" + asked.map((p) => p.id).join(","));
          const data = await answer.json();
          if (!answer.ok) { throw new Error(data.error); }
          results = data;
        } catch (error) {
          holder.replaceChildren(element("p", {}, named + ": " + error.message));
          return;
        }
      } else {
        const left = (state.scene.header.errors || {}).not_assessed || [];
        results = { values: semsfm.measure(state.scene, asked), not_assessed: left };
      }
      if (asked.some((p, k) => state.places[k] !== p) || asked.length !== state.places.length) { return; }
      state.results = results.values;
      const lines = results.values.map((one) => {
        const sigma = one.sigma > 0 ? "" : " (σ not assessed)";
        const value = semsfm.measured(one.value, one.sigma) + " " + one.unit;
        return element("p", {}, element("strong", {}, one.name + ": " + value + sigma),
          ...(one.sigma > 0 ? [" standard uncertainty, one σ"] : []),
          ...one.remarks.map((remark) => "; " + remark));
      });
      const budget = results.values.filter((one) => one.sources.length).map((one) => {
        const rows = one.sources.map(([name, u]) => element("tr", {}, element("td", { class: "text" }, name),
          element("td", {}, semsfm.number(u, 2)), element("td", {}, (100 * (u / one.sigma) ** 2).toFixed(0) + " %")));
        return element("table", {}, element("caption", {}, one.name), element("thead", {}, element("tr", {},
          element("th", { class: "text" }, "source"), element("th", {}, "u, " + one.unit), element("th", {}, "share"))),
          element("tbody", {}, ...rows));
      });
      const open = holder.querySelector("details[open]") !== null;
      const details = element("details", {}, element("summary", {}, "budget"),
        element("div", { class: "viewer-budget" }, ...budget),
        element("p", { class: "hint" }, "Not assessed: " + (results.not_assessed.join("; ") || "–") + "."));
      details.open = open;
      holder.replaceChildren(element("p", {}, named + "."), ...lines,
        element("p", {}, "The same with files: ", element("code", {}, command())), ...(budget.length ? [details] : []));
    }

    function clear() {
      state.places = [];
      say("");
      show();
    }

    return { pick, addVertex, show, clear };
  };
})();
