"""A textured square seen again by a camera that looks at it."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from benchmarks.rerender import correlations, sampled
from semsfm_colmap.surface.files import write_textured
from semsfm_colmap.surface.shading import Shading
from semsfm_colmap.types import Observations, OrthographicCameras, Reconstruction, TriangleMesh

SIZE = 64
EVEN = Shading(gradient=np.zeros(3), gain=np.ones(1))


def grey() -> np.ndarray:
    noise = np.random.default_rng(0).normal(size=(SIZE, SIZE))
    return np.clip(128 + 200 * cv2.GaussianBlur(noise, (0, 0), 1.5), 0, 255).astype(np.uint8)


def square(texture: np.ndarray) -> TriangleMesh:
    """One world unit wide in the plane z = 0, the picture upright as the camera sees it."""
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces = np.array([[0, 2, 1], [0, 3, 2]])
    uv = np.column_stack([vertices[:, 0], 1.0 - vertices[:, 1]])
    rgb = np.repeat(texture[..., None], 3, axis=2)
    return TriangleMesh(vertices=vertices, faces=faces, uv=uv[faces], texture=rgb)


def model(shift_px: float) -> Reconstruction:
    nothing = np.zeros(0, dtype=np.int64)
    return Reconstruction(
        image_names=("a.png",),
        image_size_px=np.array([[SIZE, SIZE]]),
        cameras=OrthographicCameras(
            cam_from_world=np.eye(3)[None],
            scale_px_per_unit=np.array([float(SIZE)]),
            translation_px=np.array([[shift_px, 0.0]]),
        ),
        points=np.zeros((0, 3)),
        observations=Observations(
            image_idx=nothing, track_idx=nothing, keypoint_idx=nothing, xy=np.zeros((0, 2)),
            num_images=1, num_tracks=0,
        ),
        inlier=np.zeros(0, dtype=bool),
    )  # fmt: skip


def test_a_picture_on_a_square_correlates_with_itself_and_less_when_shifted(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), grey())
    glb, _ = write_textured(square(grey()), tmp_path)
    right, near, wrong = (
        correlations(glb, EVEN, model(shift), tmp_path)[0][0] for shift in (0.0, 1.0, 10.0)
    )
    assert right.min() > 0.999
    assert 0.6 < near.min() <= near.max() < 0.95
    assert np.abs(wrong).max() < 0.2


def test_an_image_that_sees_nothing_of_the_mesh_is_not_judged(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), grey())
    glb, _ = write_textured(square(grey()), tmp_path)
    found, inside = correlations(glb, EVEN, model(5000.0), tmp_path)
    assert np.isnan(found).all()
    assert np.isnan(inside).all()


def test_a_square_seen_from_behind_is_all_inside(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), grey())
    front = square(grey())
    assert front.uv is not None
    back = replace(front, faces=front.faces[:, ::-1], uv=front.uv[:, ::-1])
    glb, _ = write_textured(back, tmp_path)
    found, inside = correlations(glb, EVEN, model(0.0), tmp_path)
    assert inside[0] == 1.0
    assert found[0, 0] > 0.999
    assert np.isnan(found[0, 1:]).all()


def test_texels_are_read_at_their_centres() -> None:
    texture = np.arange(12, dtype=np.float32).reshape(3, 4)
    u, v = np.meshgrid((np.arange(4) + 0.5) / 4, 1.0 - (np.arange(3) + 0.5) / 3)
    np.testing.assert_allclose(
        sampled(texture, np.column_stack([u.ravel(), v.ravel()])), np.arange(12), atol=1e-4
    )
