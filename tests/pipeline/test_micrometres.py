"""A known distance on a rendered series comes out right, in micrometres, up to the mesh."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.colmap.model.sparse import read_model
from semsfm_colmap.config import Config
from semsfm_colmap.evaluation.truth import Truth, load_truth
from semsfm_colmap.io.ply import read_ply_mesh
from semsfm_colmap.pipeline.evaluate import evaluate_project
from semsfm_colmap.pipeline.runner import run_stages
from semsfm_colmap.synthetic.options import SynthesizeOptions
from semsfm_colmap.synthetic.series import synthesize
from semsfm_colmap.types import Float, OrthographicCameras, Reconstruction, TriangleMesh

pytestmark = pytest.mark.slow
KNOWN_TO = 0.002
"""Relative error that a known distance may have."""
STAGES = ("ingest", "extract", "match", "map", "densify", "mesh")
SERIES = SynthesizeOptions(
    scene="field",
    num_images=9,
    step_deg=5.0,
    width_px=420,
    height_px=360,
    databar_rows=30,
    supersampling=1,
    mesh_edge_px=3.0,
    image_format="tif",
)
"""Its TIFFs carry a Zeiss header, which is the only source of the scale."""


@dataclass(frozen=True)
class Measured:
    """A finished project and its truth."""

    project: Path
    truth: Truth
    reconstruction: Reconstruction


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Measured:
    folder = synthesize(tmp_path_factory.mktemp("series"), SERIES).parent
    project = folder / "project"
    run_stages(project, Config(), names=STAGES, image_path=folder / "images")
    return Measured(
        project=project,
        truth=load_truth(folder),
        reconstruction=read_model(project / "sparse/0"),
    )


def seen(mesh: TriangleMesh, cameras: OrthographicCameras, image: int, xy: Float) -> Float:
    """Where the rays of pixels (N, 2) of an image first meet a surface; nan where they miss."""
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor(mesh.vertices.astype(np.float32)),
        o3d.core.Tensor(mesh.faces.astype(np.uint32)),
    )
    direction = cameras.viewing_direction[image]
    start = float((mesh.vertices @ direction).min()) - 1.0
    A = cameras.projection[image]
    origin = (xy - cameras.translation_px[image]) @ np.linalg.pinv(A).T + start * direction
    rays = np.hstack([origin, np.broadcast_to(direction, origin.shape)]).astype(np.float32)
    depth = scene.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy().astype(float)
    depth[~np.isfinite(depth)] = np.nan
    return np.asarray(origin + depth[:, None] * direction)


def far_pairs(true_um: Float, estimated_um: Float) -> Float:
    """Ratios of estimated to true distance over many pairs, far apart."""
    rng = np.random.default_rng(0)
    known = np.flatnonzero(np.isfinite(true_um + estimated_um).all(axis=1))
    i, j = rng.choice(known, (2, 20_000))
    true = np.linalg.norm(true_um[i] - true_um[j], axis=1)
    far = true > 0.5 * np.percentile(true, 99)
    return np.asarray(np.linalg.norm(estimated_um[i] - estimated_um[j], axis=1)[far] / true[far])


def test_the_series_is_in_micrometres_by_its_headers(measured: Measured) -> None:
    r = measured.reconstruction
    assert (r.world_unit, r.pixel_size_source) == ("um", "CZ_SEM AP_IMAGE_PIXEL_SIZE")
    assert r.pixel_size_um == pytest.approx(measured.truth.pixel_size_um, rel=KNOWN_TO / 2)


def test_the_model_is_as_large_as_the_truth(measured: Measured) -> None:
    """The scale of the similarity that aligns the cameras; it involves no surface."""
    figures, _ = evaluate_project(measured.project, measured.truth.path)
    assert abs(figures["scale_error_percent"]) < 100 * KNOWN_TO
    assert figures["mesh_to_truth_abs_p95_um"] < 4 * measured.truth.pixel_size_um


def test_distances_between_points_are_those_between_their_places_on_the_specimen(
    measured: Measured,
) -> None:
    r, truth = measured.reconstruction, measured.truth
    assert truth.mesh is not None
    middle = len(truth.names) // 2
    image = next(
        k
        for k, name in enumerate(r.image_names)
        if Path(name).stem == Path(truth.names[middle]).stem
    )
    rows = r.inlier & (r.observations.image_idx == image)
    places = seen(truth.mesh, truth.cameras, middle, r.observations.xy[rows]) * truth.unit_um
    ratio = far_pairs(places, r.points[r.observations.track_idx[rows]])
    assert len(ratio) > 1000
    assert np.median(ratio) == pytest.approx(1.0, abs=KNOWN_TO)
    assert np.percentile(np.abs(ratio - 1.0), 90) < 0.01


@pytest.mark.parametrize("where", [2, 4, 6])
def test_what_one_measures_on_the_mesh_is_what_is_there(measured: Measured, where: int) -> None:
    """Two places picked in an image, their distance on the mesh and on the true surface."""
    r, truth = measured.reconstruction, measured.truth
    assert truth.mesh is not None
    image = [Path(name).stem for name in r.image_names].index(Path(truth.names[where]).stem)
    mesh = read_ply_mesh(measured.project / "mesh/mesh.ply")
    width, height = truth.image_size_px
    xy = np.stack(np.meshgrid(np.arange(20.0, width, 10), np.arange(20.0, height, 10)), axis=-1)
    xy = xy.reshape(-1, 2)
    there = seen(truth.mesh, truth.cameras, where, xy) * truth.unit_um
    ratio = far_pairs(there, seen(mesh, r.cameras, image, xy))
    assert len(ratio) > 1000
    assert np.median(ratio) == pytest.approx(1.0, abs=KNOWN_TO)
    assert np.percentile(np.abs(ratio - 1.0), 90) < 0.01
