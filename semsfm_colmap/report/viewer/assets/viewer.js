// The viewer's controls: from the packed scene in the page, or from the server beside it.
(function () {
  "use strict";
  const semsfm = (window.semsfm = window.semsfm || {});
  const root = document.getElementById("viewer");
  if (!root) { return; }
  const live = root.dataset.mode === "live";
  const POLL_MS = 2000, FRAME_PX = 12, FIT = 1.08, MAX_RATIO = 2;
  const part = (name) => root.querySelector('[data-part="' + name + '"]');
  const canvas = part("canvas"), overlay = part("overlay"), stage = part("stage");
  const state = { scene: null, drawing: null, places: [], results: null, hovered: null, queued: false,
    navigation: null };
  const element = semsfm.element;
  const places = semsfm.measuring({ state, live, part, canvas, say, invalidate });
  let renderer = null, navigation = null;

  function measuring() { return part("measure").getAttribute("aria-pressed") === "true"; }

  function say(words) { part("message").textContent = words; }

  function colors() {
    const style = getComputedStyle(root);
    const get = (name) => style.getPropertyValue(name).trim();
    return { ink: get("--viewer-text"), ground: get("--viewer-ground"), accent: get("--viewer-accent") };
  }

  function invalidate() {
    if (state.queued) { return; }
    state.queued = true;
    requestAnimationFrame(() => { state.queued = false; draw(); });
  }

  function view() {
    const width = canvas.clientWidth, height = canvas.clientHeight, p = new THREE.Vector3();
    const inverse = navigation.camera.quaternion.clone().invert();
    return {
      width, height, unitsPerPx: navigation.unitsPerPx, unit: state.scene.header.unit, colors: colors(),
      project(point) {
        p.fromArray(point).project(navigation.camera);
        return [(p.x + 1) * width / 2, (1 - p.y) * height / 2];
      },
      direction(k) {
        const v = new THREE.Vector3().setComponent(k, 1).applyQuaternion(inverse);
        return [v.x, v.y, v.z];
      }
    };
  }

  function written(crosshair) {
    const drawing = state.drawing, frames = [];
    const framesOn = drawing.frames.visible && !drawing.looksThrough(navigation.camera);
    if (framesOn) {
      state.scene.header.frames.forEach((frame, k) => {
        if (frame.labelled) { frames.push({ words: String(frame.number), point: frameTop(k) }); }
      });
    }
    if (state.hovered !== null && framesOn) {
      const frame = state.scene.header.frames[state.hovered];
      frames.push({ words: frame.number + ": " + frame.name, point: frameTop(state.hovered) });
    }
    const legend = drawing.legend && { ...drawing.legend, map: (share) => drawing.mapped(share) };
    const marks = state.places.map((place) => ({ point: place.drawn }));
    return { frames, legend, places: marks, crosshair };
  }

  function frameTop(k) {
    const P = state.scene.arrays["frame.outline"].shape[1];
    return state.scene.arrays["frame.outline"].subarray(3 * (k * P + 2), 3 * (k * P + 2) + 3);
  }

  function draw() {
    if (!state.drawing) { return; }
    const ratio = Math.min(window.devicePixelRatio, MAX_RATIO);
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width || !height) { return; }
    renderer.setClearColor(new THREE.Color(colors().ground));
    const blend = Number(part("blend").value);
    state.drawing.draw(renderer, navigation.camera, blend);
    if (overlay.width !== Math.round(width * ratio) || overlay.height !== Math.round(height * ratio)) {
      overlay.width = Math.round(width * ratio);
      overlay.height = Math.round(height * ratio);
    }
    const crosshair = measuring() && document.activeElement === canvas;
    semsfm.viewer.scaleBar = semsfm.drawOverlay(overlay, view(), written(crosshair), ratio);
    root.classList.add("drawn");
  }

  function resize() {
    if (!renderer) { return; }
    renderer.setPixelRatio(Math.min(window.devicePixelRatio, MAX_RATIO));
    renderer.setSize(stage.clientWidth, stage.clientHeight, false);
    navigation.update();
  }

  // ---- controls ----

  function check(label, checked, changed) {
    const box = element("input", { type: "checkbox" });
    box.checked = checked;
    box.addEventListener("change", () => { changed(box.checked); invalidate(); });
    return element("label", {}, box, " " + label);
  }

  function fillControls() {
    const { header } = state.scene, drawing = state.drawing;
    const shown = state.shown || {};
    state.shown = shown;
    const boxes = drawing.layers.map((layer) => {
      layer.group.visible = shown[layer.name] ?? layer.shown;
      return check(layer.label, layer.group.visible, (on) => {
        shown[layer.name] = layer.group.visible = on;
        drawing.color(drawing.key);
      });
    });
    for (const [key, label, there] of [["frames", "cameras", header.frames], ["axis", "rotation axis", header.axis]]) {
      if (!there) { continue; }
      // in front of a surface the frames hide it: they are switched on by who wants them
      const hides = key === "frames" && drawing.layers.some((layer) => layer.kind === "mesh");
      drawing[key].visible = shown[key] ?? !hides;
      boxes.push(check(label, drawing[key].visible, (on) => { shown[key] = drawing[key].visible = on; }));
    }
    part("layers").replaceChildren(...boxes);

    const names = { own: header.texture ? "texture" : "own colours", plain: "shape alone", height: "height",
      sigma: "σ", views: "number of views", residual: "residual", label: "part" };
    const key = part("color").value || "own";
    part("color").replaceChildren(...["own", "plain", ...drawing.keys()].map((k) =>
      element("option", { value: k }, names[k])));
    part("color").value = [...part("color").options].some((o) => o.value === key) ? key : "own";
    drawing.color(part("color").value);

    part("views").replaceChildren(...header.views.map((one) => {
      const button = element("button", { type: "button" }, one.name);
      button.addEventListener("click", () => look(one.right_up_back));
      return button;
    }));
    const frame = part("frame").value;
    part("frame").replaceChildren(element("option", { value: "" }, "–"), ...(header.frames || []).map((f, k) =>
      element("option", { value: k }, f.number + ": " + f.name)));
    if ([...part("frame").options].some((o) => o.value === frame)) { part("frame").value = frame; }
    part("measuring").hidden = !state.scene.arrays["place.id"];
    section();
  }

  function look(rows) {
    navigation.orient(rows);
    navigation.fit(state.drawing.outline(), state.scene.header.center, FIT);
  }

  async function through() {
    const chosen = part("frame").value;
    if (chosen === "") { state.drawing.showPicture(null); invalidate(); return; }
    const k = Number(chosen), R = state.scene.header.frames[k].rotation;
    navigation.orient([R[0], R[1], R[2], -R[3], -R[4], -R[5], -R[6], -R[7], -R[8]]);
    const corner = state.scene.arrays["frame.corner"].subarray(12 * k, 12 * k + 12);
    const middle = [0, 1, 2].map((j) => (corner[j] + corner[6 + j]) / 2);
    navigation.fit(corner, middle, 1.02);
    const there = await state.drawing.showPicture(k, loadPicture);
    part("blend").disabled = !there;
    part("blend-hint").textContent = there ? "" : " (no image here)";
  }

  async function loadPicture(frame, k) {
    if (live) {
      const answer = await fetch("image?number=" + frame.image);
      return answer.ok ? createImageBitmap(await answer.blob()) : null;
    }
    const bytes = state.scene.arrays["picture." + k];
    return bytes ? createImageBitmap(new Blob([bytes], { type: "image/jpeg" })) : null;
  }

  // ---- section ----

  function section() {
    const chosen = part("cut").value, on = chosen !== "";
    for (const name of ["cut-at", "cut-flip"]) { part(name).disabled = !on; }
    if (!on) { state.drawing.section(null); part("cut-text").textContent = ""; return; }
    let normal = { x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1] }[chosen];
    if (chosen === "view") {
      state.cutView = state.cutView || navigation.axis(2).toArray();
      normal = state.cutView;
    }
    const n = new THREE.Vector3().fromArray(normal);
    const [low, high] = state.drawing.extent(n);
    const at = low + Number(part("cut-at").value) * (high - low);
    const flip = part("cut-flip").checked ? -1 : 1;
    state.drawing.section(n.clone().multiplyScalar(flip), flip * at);
    const origin = state.scene.header.origin;
    const there = at + n.dot(new THREE.Vector3().fromArray(origin));
    const name = chosen === "view" ? "along the view" : chosen;
    part("cut-text").textContent = name + " = " + semsfm.number(there, 4) + " " + state.scene.header.unit;
  }

  // ---- picture ----

  function exportPicture() {
    draw();
    const out = document.createElement("canvas");
    out.width = canvas.width;
    out.height = canvas.height;
    const g = out.getContext("2d");
    state.drawing.draw(renderer, navigation.camera, Number(part("blend").value));
    g.drawImage(canvas, 0, 0);
    semsfm.drawOverlay(out, view(), { ...written(false), over: true }, out.width / canvas.clientWidth);
    out.toBlob((blob) => {
      const link = element("a", { href: URL.createObjectURL(blob), download: state.scene.header.title + ".png" });
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    }, "image/png");
  }

  // ---- start ----

  function setScene(scene) {
    const first = !state.scene;
    const before = state.scene && state.scene.header;
    if (state.drawing) { state.drawing.dispose(); }
    state.scene = scene;
    state.drawing = new semsfm.Drawing(scene, invalidate);
    navigation.setRadius(scene.header.radius);
    // a model that was mapped again is another world: places and view are of the old one
    const moved = before && JSON.stringify(before.views) !== JSON.stringify(scene.header.views);
    state.places = [];
    state.cutView = null;
    fillControls();
    places.show();
    resize();
    if (first || moved) { look(scene.header.views[0].right_up_back); } else { through(); }
    semsfm.viewer.ready = true;
  }

  function hover(event) {
    if (event.buttons || !state.drawing) { return; }
    if (!state.drawing.frames.visible || state.drawing.looksThrough(navigation.camera)) {
      state.hovered = null;
      return;
    }
    const rect = canvas.getBoundingClientRect(), v = view();
    let found = null, least = FRAME_PX;
    (state.scene.header.frames || []).forEach((frame, k) => {
      const p = v.project(frameTop(k));
      const d = Math.hypot(p[0] - event.clientX + rect.left, p[1] - event.clientY + rect.top);
      if (d < least) { least = d; found = k; }
    });
    if (found !== state.hovered) { state.hovered = found; invalidate(); }
  }

  function clicked(x, y) {
    if (measuring()) { places.pick(x, y); return; }
    if (state.hovered !== null) { part("frame").value = state.hovered; through(); }
  }

  function wire() {
    part("color").addEventListener("change", () => state.drawing.color(part("color").value));
    part("frame").addEventListener("change", through);
    part("blend").addEventListener("input", invalidate);
    part("cut").addEventListener("change", () => { state.cutView = null; section(); });
    for (const name of ["cut-at", "cut-flip"]) { part(name).addEventListener("input", section); }
    part("measure").addEventListener("click", () => {
      part("measure").setAttribute("aria-pressed", String(!measuring()));
      stage.classList.toggle("picking", measuring());
      invalidate();
    });
    part("vertex-form").addEventListener("submit", (event) => {
      event.preventDefault();
      const field = part("vertex");
      if (field.value !== "" && places.addVertex(Number(field.value))) { field.value = ""; }
    });
    part("clear").addEventListener("click", places.clear);
    part("export").addEventListener("click", exportPicture);
    canvas.addEventListener("pointermove", hover);
    canvas.addEventListener("focus", invalidate);
    canvas.addEventListener("blur", invalidate);
    canvas.addEventListener("keydown", (event) => {
      if (event.key === "Escape") { part("clear").click(); }
      if (event.key === "m") { part("measure").click(); }
    });
    new ResizeObserver(resize).observe(stage);
    for (const query of ["(prefers-color-scheme: dark)", "print"]) {
      matchMedia(query).addEventListener("change", invalidate);
    }
  }

  async function poll() {
    try {
      const now = await (await fetch("state", { cache: "no-store" })).json();
      if (now.stamp !== state.stamp) {
        const answer = await fetch("scene.bin", { cache: "no-store" });
        if (answer.ok) {
          state.stamp = answer.headers.get("X-Stamp");
          setScene(semsfm.unpack(await answer.arrayBuffer()));
          say(answer.headers.get("X-Remark") || "");
        } else {
          say((await answer.json()).error);
        }
      }
      setTimeout(poll, POLL_MS);
    } catch (error) {
      if (error instanceof TypeError) {
        say("semsfm view has ended: what is shown stays, nothing more is measured");
        setTimeout(poll, 5 * POLL_MS);
      } else {
        throw error;
      }
    }
  }

  async function start() {
    try {
      renderer = new THREE.WebGLRenderer({ canvas, antialias: true });
    } catch (error) {
      say("This browser draws no WebGL" + (live ? "." : ": a still picture is shown instead."));
      root.classList.add("still");
      return;
    }
    renderer.localClippingEnabled = true;
    navigation = state.navigation = new semsfm.Navigation(canvas, 1, invalidate, clicked);
    wire();
    if (live) { poll(); return; }
    if (typeof DecompressionStream === "undefined") {
      say("This browser is too old to unpack the scene: a still picture is shown instead.");
      root.classList.add("still");
      return;
    }
    const text = document.getElementById("viewer-scene");
    setScene(semsfm.unpack(await semsfm.decompress(text.textContent)));
    text.textContent = "";
  }

  // what a script may use
  semsfm.viewer = {
    ready: false, state, pick: places.pick, addVertex: places.addVertex, draw, look,
    project: (point) => view().project(point)
  };
  start();
})();
