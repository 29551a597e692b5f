// A parallel camera that is turned, shifted and zoomed by mouse, touch and keys.
(function () {
  "use strict";
  const semsfm = (window.semsfm = window.semsfm || {});
  const CLICK_PX = 4;
  const RADIANS_PER_PX = 0.008;
  const KEY_PX = 24;
  const KEY_ZOOM = 1.15;

  semsfm.Navigation = class {
    // canvas: what is dragged on; changed: called after each move; clicked: (x, y) in px, no drag
    constructor(canvas, radius, changed, clicked) {
      this.canvas = canvas;
      this.changed = changed;
      this.clicked = clicked;
      this.camera = new THREE.OrthographicCamera();
      this.target = new THREE.Vector3();
      this.halfHeight = radius;
      this.setRadius(radius);
      this.pointers = new Map();
      this.moved = 0;
      canvas.addEventListener("pointerdown", (event) => this.down(event));
      canvas.addEventListener("pointermove", (event) => this.move(event));
      for (const name of ["pointerup", "pointercancel"]) {
        canvas.addEventListener(name, (event) => this.up(event));
      }
      canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
      canvas.addEventListener("contextmenu", (event) => event.preventDefault());
      canvas.addEventListener("keydown", (event) => this.key(event));
    }

    setRadius(radius) {
      this.radius = radius;
      this.camera.near = 0.01 * radius;
      this.camera.far = 60 * radius;
    }

    get unitsPerPx() { return (2 * this.halfHeight) / Math.max(this.canvas.clientHeight, 1); }

    axis(k) { return new THREE.Vector3().setFromMatrixColumn(this.camera.matrix, k); }

    // rows right, up, back: where the viewer stands
    orient(rows) {
      const m = new THREE.Matrix4().makeBasis(
        new THREE.Vector3(rows[0], rows[1], rows[2]), new THREE.Vector3(rows[3], rows[4], rows[5]),
        new THREE.Vector3(rows[6], rows[7], rows[8]));
      this.camera.quaternion.setFromRotationMatrix(m);
    }

    // so that points (3 n numbers) fill the canvas
    fit(points, center, margin) {
      this.target.fromArray(center);
      this.camera.updateMatrix();
      const right = this.axis(0), up = this.axis(1), p = new THREE.Vector3();
      let width = 0, height = 0;
      for (let k = 0; k < points.length; k += 3) {
        p.fromArray(points, k).sub(this.target);
        width = Math.max(width, Math.abs(p.dot(right)));
        height = Math.max(height, Math.abs(p.dot(up)));
      }
      const aspect = this.canvas.clientWidth / Math.max(this.canvas.clientHeight, 1);
      this.halfHeight = margin * Math.max(height, width / aspect, 1e-9 * this.radius);
      this.update();
    }

    update() {
      const aspect = this.canvas.clientWidth / Math.max(this.canvas.clientHeight, 1);
      const camera = this.camera;
      camera.top = this.halfHeight;
      camera.bottom = -this.halfHeight;
      camera.right = this.halfHeight * aspect;
      camera.left = -camera.right;
      const back = new THREE.Vector3(0, 0, 1).applyQuaternion(camera.quaternion);
      camera.position.copy(this.target).addScaledVector(back, 30 * this.radius);
      camera.updateMatrix();
      camera.updateMatrixWorld(true);
      camera.updateProjectionMatrix();
      this.changed();
    }

    turn(dx, dy) {
      const q = this.camera.quaternion;
      const by = (x, y, z, a) => new THREE.Quaternion().setFromAxisAngle(new THREE.Vector3(x, y, z), a);
      q.multiply(by(0, 1, 0, -dx * RADIANS_PER_PX)).multiply(by(1, 0, 0, -dy * RADIANS_PER_PX));
      q.normalize();
      this.update();
    }

    roll(angle) {
      const axis = new THREE.Vector3(0, 0, 1);
      this.camera.quaternion.multiply(new THREE.Quaternion().setFromAxisAngle(axis, angle));
      this.update();
    }

    shift(dx, dy) {
      const s = this.unitsPerPx;
      this.target.addScaledVector(this.axis(0), -dx * s).addScaledVector(this.axis(1), dy * s);
      this.update();
    }

    // about a place on the canvas, which stays where it is
    zoom(factor, x, y) {
      const rect = this.canvas.getBoundingClientRect();
      const dx = x === undefined ? 0 : x - rect.width / 2, dy = y === undefined ? 0 : y - rect.height / 2;
      const before = this.unitsPerPx;
      const least = 1e-5 * this.radius, most = 30 * this.radius;
      this.halfHeight = Math.min(most, Math.max(least, this.halfHeight / factor));
      const change = before - this.unitsPerPx;
      this.target.addScaledVector(this.axis(0), dx * change).addScaledVector(this.axis(1), -dy * change);
      this.update();
    }

    place(event) {
      const rect = this.canvas.getBoundingClientRect();
      return [event.clientX - rect.left, event.clientY - rect.top];
    }

    down(event) {
      this.canvas.setPointerCapture(event.pointerId);
      this.canvas.focus({ preventScroll: true });
      this.pointers.set(event.pointerId, this.place(event));
      this.moved = this.pointers.size > 1 ? Infinity : 0;
    }

    move(event) {
      const before = this.pointers.get(event.pointerId);
      if (!before) { return; }
      const now = this.place(event);
      const dx = now[0] - before[0], dy = now[1] - before[1];
      this.moved += Math.hypot(dx, dy);
      if (this.pointers.size === 2) {
        const other = [...this.pointers.entries()].find(([id]) => id !== event.pointerId)[1];
        const apart = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
        this.shift(dx / 2, dy / 2);
        this.zoom(apart(now) / Math.max(apart(before), 1), (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
      } else if (this.moved > CLICK_PX) {
        const pan = event.buttons !== 1 || event.shiftKey || event.ctrlKey;
        if (pan) { this.shift(dx, dy); } else { this.turn(dx, dy); }
      }
      this.pointers.set(event.pointerId, now);
    }

    up(event) {
      const there = this.pointers.delete(event.pointerId);
      const click = event.type === "pointerup" && event.button === 0;
      if (there && click && this.moved <= CLICK_PX) { this.clicked(...this.place(event)); }
    }

    // within a longer page the wheel scrolls, until somebody has gone into the picture
    wheel(event) {
      if (document.activeElement !== this.canvas && !event.ctrlKey) { return; }
      event.preventDefault();
      const lines = event.deltaMode === 1 ? 16 : 1;
      this.zoom(Math.exp(-0.0015 * lines * event.deltaY), ...this.place(event));
    }

    key(event) {
      if (event.ctrlKey || event.metaKey || event.altKey) { return; }
      const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      if (step) {
        const [dx, dy] = step.map((s) => s * KEY_PX);
        if (event.shiftKey) { this.shift(dx, dy); } else { this.turn(dx, dy); }
      } else if (event.key === "+" || event.key === "=") {
        this.zoom(KEY_ZOOM);
      } else if (event.key === "-") {
        this.zoom(1 / KEY_ZOOM);
      } else if (event.key === "[" || event.key === "]") {
        this.roll(event.key === "[" ? 0.1 : -0.1);
      } else if (event.key === "Enter" || event.key === " ") {
        this.clicked(this.canvas.clientWidth / 2, this.canvas.clientHeight / 2);
      } else {
        return;
      }
      event.preventDefault();
    }
  };
})();
