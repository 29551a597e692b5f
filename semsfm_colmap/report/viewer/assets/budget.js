// Lengths and angles between vertices with their budgets: metrology/sizes/covariance.py in the page.
// A place is {point, normal, sigma, seen}: world coordinates, and the bytes of the images' bits.
(function () {
  "use strict";
  const semsfm = (window.semsfm = window.semsfm || {});
  // budget.py
  const FOLDED = "within two standard uncertainties of 0 or 180 degrees, beyond which no angle goes: "
    + "the true one may well be 0 or 180, and the interval is not symmetric";
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
  const times = (a, f) => [a[0] * f, a[1] * f, a[2] * f];
  const norm = (a) => Math.hypot(a[0], a[1], a[2]);
  const cross = (a, b) => [
    a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
  ];

  function distance(places) {
    const apart = minus(places[1].point, places[0].point);
    const value = norm(apart);
    const u = times(apart, 1 / value);
    return { name: "length", value, dimension: 1, gradient: [times(u, -1), u] };
  }

  function angle(places) {
    const p = minus(places[0].point, places[1].point);
    const q = minus(places[2].point, places[1].point);
    const sizes = [norm(p), norm(q)];
    const u = times(p, 1 / sizes[0]), v = times(q, 1 / sizes[1]);
    const cosine = dot(u, v), sine = norm(cross(u, v));
    let byU, byV;
    if (sine < 1e-9) {
      // parallel to the last digits: the gradient in any direction across
      const k = u.map(Math.abs).indexOf(Math.min(...u.map(Math.abs)));
      const e = cross(u, [0, 1, 2].map((i) => (i === k ? 1 : 0)));
      byU = times(e, -1 / norm(e));
      byV = times(e, Math.sign(cosine) / norm(e));
    } else {
      byU = times(minus(v, times(u, cosine)), -1 / sine);
      byV = times(minus(u, times(v, cosine)), -1 / sine);
    }
    const degrees = 180 / Math.PI;
    const a = times(byU, degrees / sizes[0]), b = times(byV, degrees / sizes[1]);
    return {
      name: "angle at the second", value: Math.atan2(sine, cosine) * degrees, dimension: 0,
      gradient: [a, times([a[0] + b[0], a[1] + b[1], a[2] + b[2]], -1), b]
    };
  }

  function solve3(H, g) {
    const [a, b, c] = [[H[0], H[1], H[2]], [H[3], H[4], H[5]], [H[6], H[7], H[8]]];
    const det = dot(a, cross(b, c));
    return [dot(g, cross(b, c)) / det, dot(g, cross(c, a)) / det, dot(g, cross(a, b)) / det];
  }

  // sum over the modes of (sum over the places of g . dX)^2
  function camerasSigma(errors, arrays, places, gradient) {
    const A = arrays["errors.projection"], Q = arrays["errors.displacement"];
    const [M, , B, r] = Q.shape;
    const total = new Float64Array(r);
    places.forEach((place, a) => {
      const H = new Float64Array(9), images = [];
      for (let i = 0; i < M; i++) {
        if (!((place.seen[i >> 3] >> (i & 7)) & 1)) { continue; }
        images.push(i);
        for (let j = 0; j < 3; j++) {
          for (let k = 0; k < 3; k++) {
            H[3 * j + k] += A[6 * i + j] * A[6 * i + k] + A[6 * i + 3 + j] * A[6 * i + 3 + k];
          }
        }
      }
      const y = solve3(H, gradient[a]);
      const at = [
        ...minus(place.point, errors.center).map((x) => x / errors.radius), ...place.normal
      ];
      const monomial = errors.exponents.map((e) =>
        e.reduce((product, power, k) => product * Math.pow(at[k], power), 1));
      const ofNormal = errors.exponents.map((e) => e[3] + e[4] + e[5] > 0);
      for (const i of images) {
        const rows = [0, 1].map((x) => [0, 1, 2].map((k) => A[6 * i + 3 * x + k]));
        const faces = dot(cross(rows[0], rows[1]), place.normal) <= 0;
        for (let x = 0; x < 2; x++) {
          const along = dot(rows[x], y);
          for (let b = 0; b < B; b++) {
            if (ofNormal[b] && !faces) { continue; }
            const w = along * monomial[b], start = ((2 * i + x) * B + b) * r;
            for (let k = 0; k < r; k++) { total[k] -= w * Q[start + k]; }
          }
        }
      }
    });
    return Math.sqrt(total.reduce((sum, x) => sum + x * x, 0));
  }

  // surface_error.py
  function surfaceSources(surface, places, gradient) {
    const along = places.map((place, k) => dot(gradient[k], place.normal));
    const own = places.map((place) => Math.sqrt(Math.max(
      place.sigma ** 2 - surface.common ** 2 - surface.facing ** 2, 0)));
    let windows = 0, facing = 0;
    for (let k = 0; k < places.length; k++) {
      for (let l = 0; l < places.length; l++) {
        const d = norm(minus(places[k].point, places[l].point));
        const near = d <= surface.reach * surface.window ? Math.exp(-d / surface.window) : 0;
        const slow = Math.exp(-d / surface.slow_window);
        const rho = (1 - surface.slow_share) * near + surface.slow_share * slow;
        windows += along[k] * own[k] * along[l] * own[l] * rho;
        const apart = 1 - dot(places[k].normal, places[l].normal);
        facing += along[k] * along[l] * Math.exp(-surface.concentration * apart);
      }
    }
    const sum = along.reduce((a, b) => a + b, 0);
    return [
      ["surface: relief and noise of the windows", Math.sqrt(Math.max(windows, 0))],
      ["surface: common offset", surface.common * Math.abs(sum)],
      ["surface: offset by where it faces", surface.facing * Math.sqrt(Math.max(facing, 0))]
    ];
  }

  // Values of two or three places, as `semsfm measure --points` gives them.
  // sigma is null where the cameras' covariance or the surface's sigma is not known.
  semsfm.measure = function (scene, places) {
    const quantities = [distance(places.slice(0, 2))];
    if (places.length > 2) { quantities.push(angle(places)); }
    const errors = scene.header.errors;
    return quantities.map((quantity) => {
      const unit = quantity.dimension ? scene.header.unit : "°";
      const out = {
        name: quantity.name, value: quantity.value, unit, sigma: null, sources: [], remarks: []
      };
      const some = places.slice(0, quantity.gradient.length);
      if (!errors || !errors.cameras || !errors.surface) { return out; }
      if (some.some((place) => !place.seen || !(place.sigma >= 0))) { return out; }
      const sources = [
        ["cameras", camerasSigma(errors.cameras, scene.arrays, some, quantity.gradient)],
        ...surfaceSources(errors.surface, some, quantity.gradient)
      ];
      if (errors.scale && quantity.dimension) {
        sources.push([errors.scale.name, quantity.value * errors.scale.sigma]);
      }
      out.sources = sources.sort((a, b) => b[1] - a[1]);
      out.sigma = Math.sqrt(sources.reduce((sum, [, u]) => sum + u * u, 0));
      const folded = Math.min(quantity.value, 180 - quantity.value) < 2 * out.sigma;
      if (!quantity.dimension && folded) { out.remarks.push(FOLDED); }
      return out;
    });
  };
})();
