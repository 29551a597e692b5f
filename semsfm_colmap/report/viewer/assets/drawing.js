// The layers of a packed scene as objects of three.js, and what they are coloured by.
(function () {
  "use strict";
  const semsfm = (window.semsfm = window.semsfm || {});
  const PLAIN = 0.72, UNKNOWN = 110;
  const INSIDE = 0x8a7f70; // the back of a surface, where a section opens it
  const IMAGE_AGREES = 1 - 1e-7; // cosine between view and camera while its image is shown
  // Okabe and Ito 2008: told apart by all eyes
  const PALETTE = [
    [153, 153, 153], [86, 180, 233], [230, 159, 0], [0, 158, 115], [204, 121, 167],
    [240, 228, 66], [0, 114, 178], [213, 94, 0]
  ];
  const TITLES = {
    sigma: "standard deviation σ", views: "images that see it", residual: "residual, RMS",
    height: "height toward the first image", label: "part"
  };
  const UNITS = { views: "", residual: "px", label: "" };

  semsfm.Drawing = class {
    constructor(scene, invalidate) {
      this.header = scene.header;
      this.arrays = scene.arrays;
      this.invalidate = invalidate;
      this.world = new THREE.Scene();
      this.light = new THREE.DirectionalLight(0xffffff, 0.75);
      this.world.add(new THREE.AmbientLight(0xffffff, 0.35), this.light, this.light.target);
      this.plane = new THREE.Plane(new THREE.Vector3(1, 0, 0), 0);
      this.cut = [];
      this.layers = this.header.layers.map((layer) => this.layer(layer));
      this.frames = this.lines("frame.outline");
      this.axis = this.axisLine();
      this.picture = this.pictureQuad();
      this.color("own");
    }

    of(layer, key) { return this.arrays[layer.name + "." + key]; }

    // a page that draws again must not keep what it drew before
    dispose() {
      this.world.traverse((object) => {
        if (object.geometry) { object.geometry.dispose(); }
        if (object.material) {
          if (object.material.map) { object.material.map.dispose(); }
          object.material.dispose();
        }
      });
    }

    layer(layer) {
      const geometry = new THREE.BufferGeometry();
      const position = this.of(layer, "position");
      geometry.setAttribute("position", new THREE.BufferAttribute(position, 3));
      const count = position.length / 3;
      const color = new THREE.BufferAttribute(new Uint8Array(3 * count), 3, true);
      geometry.setAttribute("color", color);
      const group = new THREE.Group();
      const out = { ...layer, group, geometry, color, count, textured: false };
      if (layer.kind === "mesh") {
        geometry.setAttribute("normal", new THREE.BufferAttribute(this.of(layer, "normal"), 3, true));
        geometry.setIndex(new THREE.BufferAttribute(this.of(layer, "face"), 1));
        const uv = this.of(layer, "uv");
        if (uv) { geometry.setAttribute("uv", new THREE.BufferAttribute(uv, 2, true)); }
        out.solid = new THREE.MeshLambertMaterial({ vertexColors: true, side: THREE.FrontSide });
        out.inside = new THREE.MeshLambertMaterial({ color: INSIDE, side: THREE.BackSide });
        out.front = new THREE.Mesh(geometry, out.solid);
        group.add(out.front, new THREE.Mesh(geometry, out.inside));
        if (uv && this.arrays.texture) { this.texture(out); }
      } else {
        const size = (count > 100000 ? 1.2 : 2) * window.devicePixelRatio;
        const material = new THREE.PointsMaterial({ size, sizeAttenuation: false, vertexColors: true });
        out.solid = material;
        group.add(new THREE.Points(geometry, material));
      }
      group.visible = layer.shown;
      this.world.add(group);
      return out;
    }

    async texture(layer) {
      const bitmap = await this.bitmap(this.arrays.texture, this.header.texture);
      const map = new THREE.Texture(bitmap);
      map.flipY = false;
      map.anisotropy = 4;
      map.needsUpdate = true;
      layer.pictured = new THREE.MeshBasicMaterial({ map, side: THREE.FrontSide });
      layer.pictured.clippingPlanes = this.cut;
      layer.textured = true;
      this.color(this.key);
    }

    bitmap(bytes, type) {
      return createImageBitmap(new Blob([bytes], { type }), { colorSpaceConversion: "none" });
    }

    lines(name) {
      const outline = this.arrays[name];
      const group = new THREE.Group();
      if (outline) {
        const [M, P] = outline.shape;
        const points = [], colors = [];
        for (let i = 0; i < M; i++) {
          const c = this.mapped(M > 1 ? i / (M - 1) : 0);
          for (let k = 0; k + 1 < P; k++) {
            for (const end of [k, k + 1]) {
              points.push(...outline.subarray(3 * (i * P + end), 3 * (i * P + end) + 3));
              colors.push(...c.map((x) => x / 255));
            }
          }
        }
        const geometry = new THREE.BufferGeometry();
        geometry.setAttribute("position", new THREE.Float32BufferAttribute(points, 3));
        geometry.setAttribute("color", new THREE.Float32BufferAttribute(colors, 3));
        group.add(new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ vertexColors: true })));
      }
      this.world.add(group);
      return group;
    }

    axisLine() {
      const group = new THREE.Group();
      const direction = this.header.axis;
      if (direction) {
        const center = new THREE.Vector3().fromArray(this.header.center);
        const half = new THREE.Vector3().fromArray(direction)
          .multiplyScalar(this.header.axis_radii * this.header.radius);
        this.axisEnds = [center.clone().sub(half), center.clone().add(half)];
        const geometry = new THREE.BufferGeometry().setFromPoints(this.axisEnds);
        const line = new THREE.Line(geometry, new THREE.LineDashedMaterial({
          color: 0xd55e00, dashSize: 0.06 * this.header.radius, gapSize: 0.03 * this.header.radius
        }));
        line.computeLineDistances();
        group.add(line);
      }
      this.world.add(group);
      return group;
    }

    // an image of the series in the plane through the middle of the object
    pictureQuad() {
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(12), 3));
      geometry.setAttribute("uv", new THREE.Float32BufferAttribute([0, 0, 1, 0, 1, 1, 0, 1], 2));
      geometry.setIndex([0, 1, 2, 0, 2, 3]);
      const material = new THREE.MeshBasicMaterial({
        transparent: true, depthTest: false, depthWrite: false, side: THREE.DoubleSide
      });
      const quad = new THREE.Mesh(geometry, material);
      quad.renderOrder = 10;
      quad.frustumCulled = false;
      quad.visible = false;
      this.world.add(quad);
      return quad;
    }

    async showPicture(k, load) {
      this.through = k;
      this.hasPicture = false;
      if (k === null) { return false; }
      const bitmap = await load(this.header.frames[k], k);
      if (this.through !== k || !bitmap) { return false; }
      const map = new THREE.Texture(bitmap);
      map.flipY = false;
      map.needsUpdate = true;
      const material = this.picture.material;
      if (material.map) { material.map.dispose(); }
      material.map = map;
      material.needsUpdate = true;
      const corners = this.arrays["frame.corner"].subarray(12 * k, 12 * k + 12);
      this.picture.geometry.attributes.position.array.set(corners);
      this.picture.geometry.attributes.position.needsUpdate = true;
      this.hasPicture = true;
      this.invalidate();
      return true;
    }

    // whether the view is still that of the frame it was set to
    looksThrough(camera) {
      if (this.through === null || this.through === undefined) { return false; }
      const R = this.header.frames[this.through].rotation;
      const back = new THREE.Vector3(0, 0, 1).applyQuaternion(camera.quaternion);
      return -(back.x * R[6] + back.y * R[7] + back.z * R[8]) > IMAGE_AGREES;
    }

    mapped(share) {
      const k = 3 * Math.round(255 * Math.min(1, Math.max(0, share)));
      return Array.from(this.arrays.colormap.subarray(k, k + 3));
    }

    // keys that some layer has values for
    keys() {
      const found = new Set(this.layers.flatMap((layer) => layer.values));
      return ["height", "sigma", "views", "residual", "label"].filter((k) => k === "height" || found.has(k));
    }

    values(layer, key) {
      if (key !== "height") { return this.of(layer, key); }
      const p = this.of(layer, "position"), v = this.header.toward_viewer, c = this.header.center;
      const out = new Float32Array(layer.count);
      for (let k = 0; k < out.length; k++) {
        out[k] = v[0] * (p[3 * k] - c[0]) + v[1] * (p[3 * k + 1] - c[1]) + v[2] * (p[3 * k + 2] - c[2]);
      }
      return out;
    }

    // the 2 to 98 % of what is shown: a few stray values would take all colours
    range(key) {
      const all = [];
      const shown = this.layers.filter((layer) => layer.group.visible);
      for (const layer of shown.length ? shown : this.layers) {
        const values = this.values(layer, key);
        if (!values) { continue; }
        const step = Math.max(1, Math.floor(values.length / 20000));
        for (let k = 0; k < values.length; k += step) {
          if (Number.isFinite(values[k])) { all.push(values[k]); }
        }
      }
      if (!all.length) { return null; }
      all.sort((a, b) => a - b);
      const low = semsfm.quantile(all, 0.02), high = semsfm.quantile(all, 0.98);
      return { low, high: high > low ? high : low + 1, clipped: [all[0] < low, all[all.length - 1] > high] };
    }

    // own: texture or the colours that came with it; plain: only the shape
    color(key) {
      this.key = key;
      this.legend = null;
      const range = ["own", "plain", "label"].includes(key) ? null : this.range(key);
      if (range) {
        this.legend = { title: TITLES[key], unit: UNITS[key] ?? this.header.unit, ...range };
      } else if (key === "label") {
        this.legend = { title: TITLES.label, parts: [] };
        for (const [number, name] of Object.entries(this.header.labels)) {
          this.legend.parts.push({ name, color: PALETTE[number % PALETTE.length] });
        }
      }
      for (const layer of this.layers) { this.paint(layer, key, range); }
      this.invalidate();
    }

    paint(layer, key, range) {
      const out = layer.color.array;
      const values = ["own", "plain"].includes(key) ? null : this.values(layer, key);
      const own = this.of(layer, "color");
      const valued = values && (range || key === "label");
      for (let k = 0; k < layer.count; k++) {
        let c = null;
        if (valued && key === "label") {
          c = PALETTE[values[k] % PALETTE.length];
        } else if (valued) {
          const share = (values[k] - range.low) / (range.high - range.low);
          c = Number.isFinite(share) ? this.mapped(share) : [UNKNOWN, UNKNOWN, UNKNOWN];
        } else if (own && key !== "plain") {
          c = own.subarray(3 * k, 3 * k + 3);
        }
        if (c) { out.set(c, 3 * k); } else { out.fill(255 * PLAIN, 3 * k, 3 * k + 3); }
      }
      layer.color.needsUpdate = true;
      if (layer.kind === "mesh") {
        layer.front.material = key === "own" && layer.textured ? layer.pictured : layer.solid;
      }
    }

    // what lies on the side that the normal points to is taken away; null: nothing is
    section(normal, offset) {
      this.cut = normal ? [this.plane] : [];
      if (normal) {
        this.plane.normal.copy(normal).negate();
        this.plane.constant = offset;
      }
      for (const layer of this.layers) {
        for (const material of [layer.solid, layer.inside, layer.pictured]) {
          if (material) { material.clippingPlanes = this.cut; }
        }
      }
      this.invalidate();
    }

    // how far the object reaches along a direction
    extent(direction) {
      let low = Infinity, high = -Infinity;
      const p = this.body(20000);
      for (let k = 0; k < p.length; k += 3) {
        const s = p[k] * direction.x + p[k + 1] * direction.y + p[k + 2] * direction.z;
        low = Math.min(low, s);
        high = Math.max(high, s);
      }
      return [low, high];
    }

    // some points of the surface, or of all layers where there is none; stray ones left out
    body(most) {
      const out = [], c = this.header.center, reach = 2 * this.header.radius;
      const meshes = this.layers.filter((layer) => layer.kind === "mesh");
      for (const layer of meshes.length ? meshes : this.layers) {
        const p = this.of(layer, "position");
        const step = 3 * Math.max(1, Math.floor(layer.count / most));
        for (let k = 0; k < p.length; k += step) {
          const near = [0, 1, 2].every((j) => Math.abs(p[k + j] - c[j]) <= reach);
          if (near) { out.push(p[k], p[k + 1], p[k + 2]); }
        }
      }
      return out;
    }

    // what a good view shows: the object, and frames and axis where they are on
    outline() {
      const out = this.body(5000);
      if (this.frames.visible && this.arrays["frame.outline"]) { out.push(...this.arrays["frame.outline"]); }
      if (this.axis.visible && this.axisEnds) {
        this.axisEnds.forEach((end) => out.push(end.x, end.y, end.z));
      }
      return out;
    }

    // the first surface that a ray meets, nothing of what a section took away; null: none
    hit(raycaster) {
      const targets = this.layers.filter((l) => l.kind === "mesh" && l.group.visible).map((l) => l.front);
      const hits = [];
      for (const mesh of targets) {
        const side = mesh.material.side;
        mesh.material.side = THREE.DoubleSide;
        hits.push(...raycaster.intersectObject(mesh, false));
        mesh.material.side = side;
      }
      hits.sort((a, b) => a.distance - b.distance);
      const free = hits.find((h) => this.cut.every((plane) => plane.distanceToPoint(h.point) >= 0));
      return free ? free.point : null;
    }

    draw(renderer, camera, blend) {
      this.light.position.copy(camera.position);
      this.light.target.position.copy(camera.position)
        .sub(new THREE.Vector3(0, 0, 1).applyQuaternion(camera.quaternion));
      const through = this.looksThrough(camera);
      this.picture.visible = this.hasPicture && blend > 0 && through;
      this.picture.material.opacity = blend;
      // from where an image was taken the frames stand in the way
      const framesOn = this.frames.visible;
      this.frames.visible = framesOn && !through;
      renderer.render(this.world, camera);
      this.frames.visible = framesOn;
    }
  };
})();
