"""COLMAP 3.8's programs, pycolmap and open3d on what is exported: docs/exports.md has the table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.colmap.model.sparse import read_model
from semsfm_colmap.colmap.presets import settings
from semsfm_colmap.io.ply import write_ply
from semsfm_colmap.pipeline.export import export_project
from semsfm_colmap.surface.files import DepthMapFolder
from semsfm_colmap.surface.fusion.fuse import fuse
from semsfm_colmap.surface.options import SurfaceOptions
from tests.exports import consumers, readers
from tests.exports.ball_project import UNIT, write_databases
from tests.surface.scene import RADIUS

PX_PER_UNIT = 20.0 / UNIT
RADIUS_UM = RADIUS * UNIT
ERROR_PX = 0.01
MAX_TURN_DEG = 0.02

needs_colmap = pytest.mark.skipif(
    not consumers.has_colmap(), reason="no colmap binary: apt-get install colmap (Debian: 3.8)"
)


@pytest.fixture(scope="module")
def model(plain_project: Path) -> Path:
    return plain_project / "sparse" / "0"


@pytest.fixture(scope="module")
def ours(model: Path) -> consumers.Figures:
    """Images, points and mean error of the sidecar's orthographic cameras."""
    return consumers.own_figures(read_model(model))


@pytest.fixture(scope="module")
def databases(model: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return write_databases(tmp_path_factory.mktemp("databases"), read_model(model))


@pytest.fixture(scope="module")
def workspace(plain_project: Path, tmp_path_factory: pytest.TempPathFactory):
    folder = tmp_path_factory.mktemp("dense") / "workspace"
    return folder, consumers.preset_of(export_project(plain_project, "colmap-dense", folder))


def assert_same(theirs: consumers.Figures, ours: consumers.Figures) -> None:
    assert theirs.num_images == ours.num_images
    assert theirs.num_points == ours.num_points
    assert theirs.mean_error_px == pytest.approx(ours.mean_error_px, abs=ERROR_PX)


@needs_colmap
class TestColmapCommandLine:
    def test_model_analyzer_reports_our_figures(self, model, ours) -> None:
        assert_same(consumers.cli_analyze(model), ours)

    @pytest.mark.parametrize("kind", ["TXT", "NVM", "Bundler"])
    def test_model_converter_keeps_them(self, model, ours, tmp_path, kind) -> None:
        assert_same(consumers.cli_convert(model, kind, tmp_path, (160, 120)), ours)

    def test_model_converter_writes_all_points_to_ply(self, model, ours, tmp_path) -> None:
        converted = consumers.cli_convert(model, "PLY", tmp_path, (160, 120))
        assert converted.num_points == ours.num_points

    @pytest.mark.parametrize("name", ["nvm", "bundler"])
    def test_our_own_nvm_and_bundler_files_hold_the_cameras_that_colmap_writes(
        self, plain_project, model, tmp_path, name
    ) -> None:
        export_project(plain_project, name, tmp_path / "ours")
        kind, reader = {
            "nvm": ("NVM", readers.read_nvm),
            "bundler": ("Bundler", readers.read_bundler),
        }[name]
        consumers.cli_convert(model, kind, tmp_path / "theirs", (160, 120))
        theirs, mine = reader(tmp_path / "theirs"), reader(tmp_path / "ours")
        assert set(theirs.views) == set(mine.views)
        for image, view in mine.views.items():
            assert np.allclose(view.R, theirs.views[image].R, atol=1e-12)
            assert np.allclose(view.t, theirs.views[image].t, rtol=1e-9, atol=1e-7)
            assert np.allclose(view.K, theirs.views[image].K, rtol=1e-6)

    def test_bundle_adjuster_leaves_the_cameras_where_they_are(self, model, ours, tmp_path) -> None:
        assert_same(consumers.cli_bundle_adjust(model, tmp_path), ours)
        assert consumers.rotation_change_deg(model, tmp_path) < MAX_TURN_DEG

    def test_point_triangulator_finds_the_points_again(
        self, plain_project, model, ours, databases, tmp_path
    ) -> None:
        images = plain_project / "images"
        assert_same(consumers.cli_triangulate(model, databases[0], images, tmp_path), ours)

    def test_point_triangulator_takes_the_project_s_database_as_it_is_exported(
        self, plain_project, ours, tmp_path
    ) -> None:
        export_project(plain_project, "database-38", tmp_path / "old")
        model, database = tmp_path / "old" / "sparse", tmp_path / "old" / "database.db"
        images = plain_project / "images"
        assert_same(consumers.cli_triangulate(model, database, images, tmp_path / "new"), ours)

    def test_image_undistorter_changes_nothing(self, plain_project, model, ours, tmp_path) -> None:
        assert_same(consumers.cli_undistort(model, plain_project / "images", tmp_path), ours)
        copied = sorted(p.name for p in (tmp_path / "images").iterdir())
        assert copied == sorted(p.name for p in (plain_project / "images").iterdir())

    def test_stereo_fusion_and_poisson_mesher_run_on_the_dense_workspace(
        self, workspace, tmp_path
    ) -> None:
        folder, preset = workspace
        assert consumers.cli_fuse(folder, preset) > 3000
        assert consumers.cli_poisson(folder / "fused_cli.ply", tmp_path / "mesh.ply") > 1000

    def test_the_project_ini_has_only_keys_that_colmap_knows(self, workspace, tmp_path) -> None:
        folder, preset = workspace
        consumers.run_colmap("project_generator", "--output_path", tmp_path / "all.ini")
        known: dict[str, set[str]] = {}
        section = ""
        for line in (tmp_path / "all.ini").read_text().splitlines():
            if line.startswith("["):
                section = line.strip("[]")
            elif "=" in line:
                known.setdefault(section, set()).add(line.split("=")[0])
        for section, values in settings(preset).items():
            assert set(values) <= known[section]
        assert "[StereoFusion]\nmax_depth_error=" in (folder / "project.ini").read_text()


class TestPycolmap:
    def test_it_reads_our_figures(self, model, ours) -> None:
        assert_same(consumers.figures(consumers.read(model)), ours)

    def test_triangulation_with_the_preset_finds_the_points_again(
        self, plain_project, model, ours, databases, tmp_path
    ) -> None:
        images = plain_project / "images"
        assert_same(consumers.py_triangulate(model, databases[1], images, tmp_path), ours)

    def test_without_the_preset_every_point_is_filtered(
        self, plain_project, model, databases, tmp_path, monkeypatch
    ) -> None:
        """What the ratio filters are for: this guards the reason of the preset."""
        monkeypatch.setattr(
            consumers, "pipeline_options", consumers.pycolmap.IncrementalPipelineOptions
        )
        images = plain_project / "images"
        left = consumers.py_triangulate(model, databases[1], images, tmp_path)
        assert left.num_points == 0

    def test_bundle_adjustment_with_the_preset_leaves_the_cameras(
        self, model, ours, tmp_path
    ) -> None:
        assert_same(consumers.py_bundle_adjust(model, tmp_path), ours)
        assert consumers.rotation_change_deg(model, tmp_path) < MAX_TURN_DEG

    def test_undistortion_changes_nothing(self, plain_project, model, ours, tmp_path) -> None:
        assert_same(consumers.py_undistort(model, plain_project / "images", tmp_path), ours)

    def test_stereo_fusion_of_our_maps_lies_on_the_ball(self, workspace, tmp_path) -> None:
        folder, preset = workspace
        assert consumers.py_fuse(folder, preset) > 3000
        points = consumers.open3d_cloud(folder / "fused.ply")
        gap = (np.linalg.norm(points, axis=1) - RADIUS_UM) * PX_PER_UNIT
        assert np.median(np.abs(gap)) < 0.1
        # half a pixel of offset or the pinhole's perspective would show here
        assert abs(np.median(gap)) < 0.05
        direction = points / np.linalg.norm(points, axis=1, keepdims=True)
        shift = np.linalg.lstsq(direction, gap, rcond=None)[0]
        assert np.abs(shift).max() < 0.1
        assert consumers.py_poisson(folder / "fused.ply", tmp_path / "mesh.ply") > 1000

    def test_stereo_fusion_finds_the_surface_of_our_own_fusion(
        self, plain_project, workspace, tmp_path
    ) -> None:
        folder, preset = workspace
        consumers.py_fuse(folder, preset)
        made = read_model(plain_project / "sparse" / "0")
        maps = DepthMapFolder(plain_project / "dense" / "depth_maps", made.image_names)
        own = fuse(maps, made, plain_project / "images", SurfaceOptions())
        write_ply(tmp_path / "own.ply", own)
        gap = consumers.surface_gap_px(folder / "fused.ply", tmp_path / "own.ply", PX_PER_UNIT)
        assert np.median(np.abs(gap)) < 0.5
        assert np.quantile(np.abs(gap), 0.9) < 1.0

    def test_stereo_fusion_takes_special_names(self, workspace, special_project, tmp_path) -> None:
        summary = export_project(special_project, "colmap-dense", tmp_path / "w w")
        num = consumers.py_fuse(tmp_path / "w w", consumers.preset_of(summary))
        folder, preset = workspace
        assert num == pytest.approx(consumers.py_fuse(folder, preset), rel=0.01)


class TestOpen3d:
    def test_it_reads_the_points_with_their_attributes(self, plain_project, tmp_path) -> None:
        export_project(plain_project, "ply", tmp_path / "out")
        points = consumers.open3d_cloud(tmp_path / "out" / "points.ply")
        made = read_model(plain_project / "sparse" / "0")
        assert 0.8 * len(made.points) < len(points) <= len(made.points)
        gap = (np.linalg.norm(points, axis=1) - RADIUS_UM) * PX_PER_UNIT
        assert np.median(np.abs(gap)) < 0.2

    def test_its_tsdf_of_our_depth_maps_is_the_ball(self, workspace) -> None:
        folder, preset = workspace
        vertices = consumers.open3d_tsdf(folder, preset, 1.5 / PX_PER_UNIT)
        assert len(vertices) > 2000
        gap = (np.linalg.norm(vertices, axis=1) - RADIUS_UM) * PX_PER_UNIT
        assert np.median(np.abs(gap)) < 0.5


class TestTrainers:
    """Readers written from the documentation of each program accept the folders."""

    def test_gsplat_and_opensplat(self, special_project, tmp_path) -> None:
        export_project(special_project, "colmap-float32", tmp_path / "out")
        assert len(readers.splatting_folder(tmp_path / "out").views) == 11

    def test_openmvs(self, plain_project, tmp_path) -> None:
        export_project(plain_project, "openmvs", tmp_path / "out")
        assert len(readers.openmvs_folder(tmp_path / "out").views) == 11
        assert not (tmp_path / "out" / "sparse" / "0").exists()

    def test_nerfstudio(self, special_project, tmp_path) -> None:
        summary = export_project(special_project, "nerfstudio", tmp_path / "out")
        views, scale = readers.read_transforms(tmp_path / "out")
        assert len(views) == 11
        points = consumers.open3d_cloud(tmp_path / "out" / "sparse_pc.ply")
        assert 0.5 <= np.abs(points).max() <= 1.0
        assert summary["world_scale"] == scale
