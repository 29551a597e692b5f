"""Cast parallel rays at the specimen and shade what they hit as secondary electrons do.

The yield of a surface grows as its normal turns away from the beam, for more of the excited volume
then lies within the escape depth: ``1 / cos(theta)^n``, the secant law [Reimer, Scanning Electron
Microscopy, 2nd ed. 1998, sec. 4.2]. A detector on one side, thin parts that shine through, cavities
that hold electrons back and the enhanced emission of ridges modulate it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from semsfm_colmap.geometry.mesh_normals import vertex_normals
from semsfm_colmap.io.open3d_rays import as_tensor, ray_scene
from semsfm_colmap.synthetic import surface
from semsfm_colmap.synthetic.options import SynthesizeOptions
from semsfm_colmap.synthetic.scenes.base import SUPPORT, Specimen
from semsfm_colmap.types import Array, Float, OrthographicCameras

DETECTOR = np.array([0.35, -0.75, -0.55]) / np.linalg.norm([0.35, -0.75, -0.55])
"""Direction from the specimen to the detector in the camera frame: up, right, toward the beam."""
MAX_YIELD = 4.6
"""Bound on the secant law: at grazing incidence roughness and surface barrier end the growth."""
SUPPORT_CONTRAST = 0.3
"""Contrast of the support's material relative to the specimen's: metal, not tissue."""
THIN_PX = 8.0
"""Thickness at which the glow of thin parts has fallen to 1 / e."""
EDGE_SCALES_PX = (2.5, 6.0)
"""Widths of the neighbourhoods against which ridges and grooves stand out."""
REGION_MARGIN_PX = 4.0
"""Room around the projected vertices for the displacement of scan lines."""
SHADOW_LIFT = 4e-3
"""Start of shadow rays above the surface, in scene units, so that it does not shadow itself."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Renderer:
    """A specimen made ready: its ray caster and the brightness that does not depend on the view."""

    scene: Any
    faces: Array
    attributes: Array
    """(V, 5) float32: normal (3), brightness of material, cavities and ridges, glow when thin"""
    coordinates: Array
    """(3, V) float32: the vertices"""
    options: SynthesizeOptions

    def frame(
        self, cameras: OrthographicCameras, image_idx: int, row_shift_px: Float, width: int
    ) -> tuple[Array, Array]:
        """Render one frame: signal (H, W), about 1 where the beam is normal, and coverage 0..1.

        Parameters
        ----------
        cameras : of the series
        image_idx : which one
        row_shift_px : (H, 2) displacement of each scan line
        width : of the image, px

        """
        import cv2

        ss = self.options.supersampling
        height = len(row_shift_px)
        camera = cameras.select(np.array([image_idx]))
        x0, y0, x1, y1 = self._region(camera, width, height)
        signal = np.zeros((height, width), np.float32)
        coverage = np.zeros((height, width), np.float32)
        if x1 <= x0 or y1 <= y0:
            return signal, coverage
        u = (np.arange(x0 * ss, x1 * ss) + 0.5) / ss
        v = (np.arange(y0 * ss, y1 * ss) + 0.5) / ss
        shift = row_shift_px[np.repeat(np.arange(y0, y1), ss)]
        image, hit = self._shade(camera, u, v, shift)
        size = (x1 - x0, y1 - y0)
        signal[y0:y1, x0:x1] = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        coverage[y0:y1, x0:x1] = cv2.resize(hit, size, interpolation=cv2.INTER_AREA)
        return signal, coverage

    def _region(
        self, camera: OrthographicCameras, width: int, height: int
    ) -> tuple[int, int, int, int]:
        """Pixels x0, y0, x1, y1 outside of which no ray hits."""
        xy = camera.projection[0].astype(np.float32) @ self.coordinates
        low = xy.min(axis=1) + camera.translation_px[0] - REGION_MARGIN_PX
        high = xy.max(axis=1) + camera.translation_px[0] + REGION_MARGIN_PX
        x0, y0 = np.maximum(np.floor(low), 0).astype(int)
        x1, y1 = np.minimum(np.ceil(high), [width, height]).astype(int)
        return int(x0), int(y0), int(x1), int(y1)

    def _rays(self, camera: OrthographicCameras, u: Float, v: Float, shift: Float) -> Array:
        """Parallel rays (h, w, 6) float32 of the pixels (u, v), rows displaced by `shift`."""
        R, scale = camera.cam_from_world[0], camera.scale_px_per_unit[0]
        t = camera.translation_px[0]
        y_cam = (v - shift[:, 1] - t[1]) / (scale * camera.aspect)
        x_of_row = -shift[:, 0] / scale - camera.skew * y_cam
        x_of_column = (u - t[0]) / scale
        z = float((R[2].astype(np.float32) @ self.coordinates).min()) - 1.0
        of_row = np.outer(x_of_row, R[0]) + np.outer(y_cam, R[1]) + z * R[2]
        of_column = np.outer(x_of_column, R[0])
        rays = np.empty((len(v), len(u), 6), np.float32)
        np.add(of_row[:, None], of_column[None], out=rays[..., :3], casting="same_kind")
        rays[..., 3:] = R[2]
        return rays

    def _shade(
        self, camera: OrthographicCameras, u: Float, v: Float, shift: Float
    ) -> tuple[Array, Array]:
        """Signal and hit mask (h, w) float32 of the rays of `_rays`."""
        o = self.options
        R = camera.cam_from_world[0]
        rays = self._rays(camera, u, v, shift)
        answer = self.scene.cast_rays(as_tensor(rays))
        depth = answer["t_hit"].numpy()
        mask = np.isfinite(depth)
        signal = np.zeros(depth.shape, np.float32)
        hit = np.flatnonzero(mask)
        if not hit.size:
            return signal, mask.astype(np.float32)
        corner = self.faces[answer["primitive_ids"].numpy().reshape(-1)[hit]]
        bary = answer["primitive_uvs"].numpy().reshape(-1, 2)[hit]
        a = self.attributes[corner[:, 0]] * (1.0 - bary[:, :1] - bary[:, 1:])
        a += self.attributes[corner[:, 1]] * bary[:, :1]
        a += self.attributes[corner[:, 2]] * bary[:, 1:]
        toward = np.stack([R[2], DETECTOR @ R], axis=1).astype(np.float32)
        length = np.maximum(np.sqrt(np.einsum("ij,ij->i", a[:, :3], a[:, :3])), 1e-6)
        along_beam, to_detector = ((a[:, :3] @ toward) / length[:, None]).T
        value = np.maximum(-along_beam, 1e-3) ** np.float32(-o.secant_exponent)
        value = np.minimum(value, MAX_YIELD) * (1.0 + o.detector_strength * to_detector)
        if o.shadowing > 0:
            value *= self._shadow(rays[mask], depth[mask], a[:, :3], R)
        value = value * a[:, 3] + o.thin_strength * a[:, 4]
        signal.reshape(-1)[hit] = np.maximum(value, 0.0)
        return signal, mask.astype(np.float32)

    def _shadow(self, rays: Array, depth: Array, normal: Array, R: Float) -> Array:
        """Factor on the signal of each hit: below 1 where the way to the detector is barred."""
        toward = np.empty((len(depth), 6), np.float32)
        toward[:, :3] = rays[:, :3] + depth[:, None] * rays[:, 3:] + SHADOW_LIFT * normal
        toward[:, 3:] = DETECTOR @ R
        barred = self.scene.test_occlusions(as_tensor(toward)).numpy()
        return np.asarray(1.0 - self.options.shadowing * barred, dtype=np.float32)


def make_renderer(
    specimen: Specimen, options: SynthesizeOptions, scale: float, rng: np.random.Generator
) -> Renderer:
    """Prepare a specimen: build the ray caster, find its cavities, ridges and thin parts.

    Parameters
    ----------
    specimen : what to render
    options : contrasts and strengths
    scale : px per scene unit, for what is measured in px
    rng : source of the directions tried

    """
    scene = ray_scene(specimen.vertices, specimen.faces)
    normals = vertex_normals(specimen.vertices, specimen.faces)
    contrast = np.where(specimen.label == SUPPORT, SUPPORT_CONTRAST, 1.0)
    material = 1.0 + options.albedo_contrast * contrast * specimen.texture
    free = surface.openness(specimen, normals, scene, rng)
    material = material.clip(0.3, 2.0) * (1.0 - options.cavity_strength * (1.0 - free))
    ridge = np.zeros(len(normals))
    for width_px in EDGE_SCALES_PX:
        ridge += surface.convexity(specimen, normals, width_px / scale).clip(-1.5, 1.5)
    material *= np.maximum(1.0 + options.edge_strength * ridge / len(EDGE_SCALES_PX), 0.0)
    glow = np.exp(-surface.thickness(specimen, normals, scene) * scale / THIN_PX)
    attributes = np.column_stack([normals, material, glow]).astype(np.float32)
    return Renderer(
        scene=scene,
        faces=specimen.faces,
        attributes=attributes,
        coordinates=np.ascontiguousarray(specimen.vertices.T, dtype=np.float32),
        options=options,
    )
