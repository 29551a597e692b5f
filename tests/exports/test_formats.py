"""What every format must keep; one class a format says how it is read back."""

from __future__ import annotations

import csv
import json
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from semsfm_colmap.colmap.database.reader import read_database
from semsfm_colmap.colmap.database.work import read_images
from semsfm_colmap.colmap.model.sparse import read_model
from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.exports import formats
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.registry import FORMATS, find_format
from semsfm_colmap.exports.scene import ExportScene, Summary
from semsfm_colmap.pipeline.export import export_project
from tests.exports import readers
from tests.exports.ball_project import SPECIAL_NAMES
from tests.oracles import tilt_series as tilt_oracle

ROUNDING_PX = 1e-4
"""Double precision at a distance of some 1e5 px, the digits of text included."""


class ExportContract:
    name: str
    survives = True
    """Whether names with spaces survive; otherwise they are refused."""
    has_images = False
    rgb_images = False
    """where a grey image has three channels, unless it is asked to stay grey"""

    @pytest.fixture
    def exported(self, plain_exports) -> tuple[Path, Summary]:
        """One export for the tests that only look."""
        return plain_exports(self.name)

    def projections(self, folder: Path, image: str, points: np.ndarray) -> np.ndarray:
        """Where the exported camera sees points of the project's world: (N, 3) -> (N, 2) px."""
        raise NotImplementedError

    def names(self, folder: Path) -> set[str]:
        raise NotImplementedError

    def test_its_cameras_see_what_the_orthographic_ones_see(self, plain_project, exported):
        folder, summary = exported
        model = read_model(plain_project / "sparse" / "0")
        obs = model.observations
        worst = 0.0
        for i, name in enumerate(model.image_names):
            X = model.points[obs.track_idx[obs.image_idx == i]]
            ours = model.cameras.project(X, np.full(len(X), i))
            gap = self.projections(folder, name, X) - ours
            worst = max(worst, float(np.linalg.norm(gap, axis=1).max()))
        assert worst <= summary["max_deviation_px"] + ROUNDING_PX
        # the stated deviation is reached, not a loose bound
        assert worst >= 0.99 * summary["max_deviation_px"] - ROUNDING_PX

    def test_special_names_survive_or_are_refused_in_one_sentence(self, special_project, tmp_path):
        target = tmp_path / "out put"
        if not self.survives:
            with pytest.raises(InputError, match=r"'a b\.png'.*white space.*--plain_names") as info:
                export_project(special_project, self.name, target)
            assert "\n" not in str(info.value)
            assert not target.exists()
            return
        export_project(special_project, self.name, target)
        assert self.names(target) >= set(SPECIAL_NAMES)
        if self.has_images:
            assert all((target / "images" / name).is_file() for name in SPECIAL_NAMES)

    def test_plain_names_always_work_and_are_listed(self, special_project, tmp_path):
        options = FormatOptions(plain_names=True)
        export_project(special_project, self.name, tmp_path / "out", options=options)
        with (tmp_path / "out" / "names.csv").open(encoding="utf-8", newline="") as file:
            table = list(csv.DictReader(file))
        assert [row["project"] for row in table][:4] == list(SPECIAL_NAMES)
        exported = {row["export"] for row in table}
        assert self.names(tmp_path / "out") == exported
        for row in table:
            copy = tmp_path / "out" / "images" / row["export"]
            source = special_project / "images" / row["project"]
            if not self.rgb_images:
                assert copy.read_bytes() == source.read_bytes()
                continue
            # a loader that takes [..., :3] of what it reads takes channels, not columns
            pixels = np.asarray(Image.open(copy))
            assert pixels.shape[2:] == (3,)
            assert np.array_equal(pixels, np.asarray(Image.open(source).convert("RGB")))

    def test_grey_images_stay_grey_where_that_is_asked(self, plain_project, tmp_path):
        if not self.rgb_images:
            return
        options = FormatOptions(grey_images=True)
        export_project(plain_project, self.name, tmp_path / "out", options=options)
        for copy in (tmp_path / "out" / "images").iterdir():
            assert copy.read_bytes() == (plain_project / "images" / copy.name).read_bytes()

    def test_the_folder_states_what_was_written(self, exported):
        folder, summary = exported
        assert summary["format"] == self.name
        assert summary["num_images"] == 11
        assert summary["num_points"] > 500
        stated = json.loads((folder / "export.json").read_text(encoding="utf-8"))
        assert stated == json.loads(json.dumps(summary, default=float))

    def test_an_older_export_is_replaced_whole_and_foreign_files_are_not(
        self, plain_project, tmp_path
    ):
        export_project(plain_project, self.name, tmp_path / "out")
        (tmp_path / "out" / "stray").write_text("x")
        export_project(plain_project, self.name, tmp_path / "out")
        assert not (tmp_path / "out" / "stray").exists()
        assert [p.name for p in tmp_path.iterdir()] == ["out"]
        foreign = tmp_path / "foreign"
        foreign.mkdir()
        (foreign / "thesis.txt").write_text("x")
        with pytest.raises(UsageError, match="did not write"):
            export_project(plain_project, self.name, foreign)
        assert [p.name for p in foreign.iterdir()] == ["thesis.txt"]

    def test_an_export_that_fails_leaves_the_older_one(self, plain_project, tmp_path, monkeypatch):
        export_project(plain_project, self.name, tmp_path / "out")
        before = sorted((p.name, p.stat().st_mtime_ns) for p in (tmp_path / "out").rglob("*"))

        def fail(*_: object) -> None:
            raise OSError(5, "Input/output error")

        writer = find_format(self.name).writer()

        def interrupted(scene: ExportScene, folder: Path, options: FormatOptions) -> None:
            writer(scene, folder, options)
            fail()

        monkeypatch.setattr("semsfm_colmap.exports.registry.Format.writer",
                            lambda self: interrupted)  # fmt: skip
        with pytest.raises(OSError, match="Input/output"):
            export_project(plain_project, self.name, tmp_path / "out")
        after = sorted((p.name, p.stat().st_mtime_ns) for p in (tmp_path / "out").rglob("*"))
        assert after == before
        assert [p.name for p in tmp_path.iterdir()] == ["out"]


class SceneContract(ExportContract):
    """Formats that a reader turns into a `Scene` with measurements."""

    centred = False
    y_up = False

    def read(self, folder: Path) -> readers.Scene:
        raise NotImplementedError

    def names(self, folder: Path) -> set[str]:
        return set(self.read(folder).views)

    def projections(self, folder: Path, image: str, points: np.ndarray) -> np.ndarray:
        if not hasattr(self, "cache") or self.cache[0] != folder:
            self.cache = (folder, self.read(folder))
        xy = self.cache[1].views[image].project(points)
        if self.y_up:
            xy = xy * [1.0, -1.0]
        return xy + np.array([80.0, 60.0]) if self.centred else xy

    def test_measurements_stay_with_their_points(self, plain_project, exported):
        scene = self.read(exported[0])
        model = read_model(plain_project / "sparse" / "0")
        errors = [
            np.linalg.norm(
                view.project(np.array([scene.points[int(j)] for j in view.point_ids[owned]]))
                - view.xy[owned],
                axis=1,
            )
            for view in scene.views.values()
            for owned in [view.point_ids >= 0]
        ]
        mean = float(np.mean(np.concatenate(errors)))
        ours = float(np.linalg.norm(model.residuals(), axis=1).mean())
        assert mean == pytest.approx(ours, abs=0.01)
        assert sum(len(e) for e in errors) == len(model.observations)
        assert len(scene.points) == len(model.points)


class TestColmapBinary(SceneContract):
    name = "colmap-bin"

    def read(self, folder: Path) -> readers.Scene:
        return readers.read_binary(folder)

    def test_it_is_the_project_s_own_model_byte_by_byte(self, special_project, tmp_path):
        export_project(special_project, self.name, tmp_path / "out")
        for name in ("cameras", "images", "points3D", "rigs", "frames"):
            ours = (special_project / "sparse" / "0" / f"{name}.bin").read_bytes()
            assert (tmp_path / "out" / f"{name}.bin").read_bytes() == ours


class TestColmapText(SceneContract):
    name = "colmap-text"
    survives = False

    def read(self, folder: Path) -> readers.Scene:
        return readers.read_text(folder)


class TestDatabase38(SceneContract):
    name = "database-38"

    def read(self, folder: Path) -> readers.Scene:
        return readers.read_binary(folder / "sparse")

    def names(self, folder: Path) -> set[str]:
        with closing(sqlite3.connect(folder / "database.db")) as db:
            stored = {row[0] for row in db.execute("SELECT name FROM images")}
        assert stored == super().names(folder)
        return stored

    def test_database_and_model_share_ids_and_keypoints(self, plain_project, exported):
        folder, _ = exported
        ids = {image.image_id: image.name for image in read_images(plain_project / "database.db")}
        with read_database(folder / "database.db") as reader:
            assert {image.image_id: image.name for image in reader.images()} == ids
            stored = {name: reader.keypoints(image_id) for image_id, name in ids.items()}
        for name, view in self.read(folder).views.items():
            assert np.allclose(stored[name][:, :2], view.xy, atol=1e-4)

    def test_without_a_database_it_says_so(self, plain_project, tmp_path):
        shutil.copytree(plain_project, tmp_path / "p")
        (tmp_path / "p" / "database.db").unlink()
        with pytest.raises(InputError, match=r"database\.db does not exist"):
            export_project(tmp_path / "p", self.name, tmp_path / "out")
        assert not (tmp_path / "out").exists()

    def test_a_plain_name_that_another_image_has_is_refused(self, plain_project, tmp_path):
        """The database knows an image that the model does not hold."""
        shutil.copytree(plain_project, tmp_path / "p")
        with closing(sqlite3.connect(tmp_path / "p" / "database.db")) as db:
            db.execute("INSERT INTO images (name, camera_id) VALUES ('image_0002.png', 1)")
            db.commit()
        options = FormatOptions(plain_names=True)
        with pytest.raises(InputError, match="has one of the plain names already"):
            export_project(tmp_path / "p", self.name, tmp_path / "out", options=options)


class TestColmapFloat32(SceneContract):
    name = "colmap-float32"
    has_images = True
    rgb_images = True

    def read(self, folder: Path) -> readers.Scene:
        return readers.splatting_folder(folder)

    def test_float32_arithmetic_keeps_the_stated_deviation(self, exported):
        folder, summary = exported
        assert 300.0 <= summary["focal_factor"] <= 1000.0
        scene = self.read(folder)
        single = np.float32
        for view in scene.views.values():
            X = np.array(list(scene.points.values()))
            x = X.astype(single) @ view.R.T.astype(single) + view.t.astype(single)
            focal = np.diag(view.K)[:2].astype(single)
            xy = focal * x[:, :2] / x[:, 2:] + view.K[:2, 2].astype(single)
            assert xy.dtype == single
            assert np.abs(xy - view.project(X)).max() < 0.01


class TestOpenMvs(SceneContract):
    name = "openmvs"
    survives = False
    has_images = True
    rgb_images = True

    def read(self, folder: Path) -> readers.Scene:
        return readers.openmvs_folder(folder)


class TestBundler(SceneContract):
    name = "bundler"
    survives = False
    centred = True
    y_up = True

    def read(self, folder: Path) -> readers.Scene:
        return readers.read_bundler(folder)


class TestNvm(SceneContract):
    name = "nvm"
    survives = False
    centred = True

    def read(self, folder: Path) -> readers.Scene:
        return readers.read_nvm(folder)


class TestColmapDense(SceneContract):
    name = "colmap-dense"
    has_images = True

    def read(self, folder: Path) -> readers.Scene:
        return readers.read_binary(folder / "sparse")


class TestNerfstudio(ExportContract):
    name = "nerfstudio"
    has_images = True
    rgb_images = True

    def names(self, folder: Path) -> set[str]:
        return set(readers.read_transforms(folder)[0])

    def projections(self, folder: Path, image: str, points: np.ndarray) -> np.ndarray:
        views, scale = readers.read_transforms(folder)
        return views[image].project(scale * points)


class TestNfhSem(ExportContract):
    name = "nfh-sem"
    has_images = True

    def names(self, folder: Path) -> set[str]:
        with np.load(folder / "cameras.npz", allow_pickle=False) as data:
            return set(data["names"].tolist())

    def projections(self, folder: Path, image: str, points: np.ndarray) -> np.ndarray:
        with np.load(folder / "cameras.npz", allow_pickle=False) as data:
            P = data["projection"][data["names"].tolist().index(image)]
        return points @ P[:, :3].T + P[:, 3]

    def test_depth_lies_on_the_surface_with_normals_toward_the_viewer(self, exported):
        folder, _ = exported
        with np.load(folder / "cameras.npz") as data:
            R, s, t = (
                data[k][3] for k in ("cam_from_world", "scale_px_per_unit", "translation_px")
            )
            assert data["has_depth"].all()
        with np.load(folder / "depth" / "view_03.png.npz") as data:
            depth, normal = data["depth"], data["normal"]
        row, col = np.nonzero(np.isfinite(depth))
        xy = (np.column_stack([col, row]) + 0.5 - t) / s
        X = np.column_stack([xy, depth[row, col]]) @ R
        # the depth maps are of the ball of radius 2.2 x 0.05, seen with the magnification 20 / 0.05
        assert np.abs(np.linalg.norm(X, axis=1) / 0.05 - 2.2).max() < 0.01
        inner = -(X / np.linalg.norm(X, axis=1, keepdims=True)) @ R[2] > 0.5
        cosine = np.sum(normal[row, col] * X, axis=1) / np.linalg.norm(X, axis=1)
        assert cosine[inner].min() > 0.98


class TiltSeriesContract(ExportContract):
    def views(self, folder: Path) -> list[tilt_oracle.View]:
        raise NotImplementedError

    def names(self, folder: Path) -> set[str]:
        return set(self.order(folder))

    def order(self, folder: Path) -> list[str]:
        with (folder / "views.csv").open(encoding="utf-8", newline="") as file:
            return [row["image"] for row in csv.DictReader(file)]

    def projections(self, folder: Path, image: str, points: np.ndarray) -> np.ndarray:
        stated = json.loads((folder / "export.json").read_text(encoding="utf-8"))
        to_tomogram = np.array(stated["tomogram_px_from_world"])
        view = self.views(folder)[self.order(folder).index(image)]
        q = (points @ to_tomogram[:, :3].T + to_tomogram[:, 3]) @ view.L.T + view.q0
        return np.array([80.0, 60.0]) + q * [1.0, -1.0]


class TestImod(TiltSeriesContract):
    name = "imod"

    def views(self, folder: Path) -> list[tilt_oracle.View]:
        return tilt_oracle.imod_views(folder)


class TestAreTomo(TiltSeriesContract):
    name = "aretomo"

    def views(self, folder: Path) -> list[tilt_oracle.View]:
        return tilt_oracle.aretomo_views(folder / "series.aln")


class TestRelionStar(TiltSeriesContract):
    name = "relion-star"

    def views(self, folder: Path) -> list[tilt_oracle.View]:
        return tilt_oracle.relion_views(folder)


class WithoutImages(ExportContract):
    def names(self, folder: Path) -> set[str]:
        """Points and triangles have no images: those they were made from stand in names.csv."""
        path = folder / "names.csv"
        if not path.is_file():
            return set(SPECIAL_NAMES)
        with path.open(encoding="utf-8", newline="") as file:
            return {row["export"] for row in csv.DictReader(file)}


class TestStl(WithoutImages):
    name = "stl"

    def test_its_cameras_see_what_the_orthographic_ones_see(self, plain_project, exported):
        """No cameras: the triangles are those of the mesh, a thousand times as large."""
        mesh = trimesh.load(exported[0] / f"mesh.{self.name}", force="mesh")
        own = trimesh.load(plain_project / "mesh/mesh.ply", force="mesh")
        assert len(mesh.faces) == len(own.faces)
        # micrometres as millimetres
        np.testing.assert_allclose(mesh.extents, own.extents, rtol=1e-5)
        assert mesh.area == pytest.approx(own.area, rel=1e-4)


class TestThreeMf(TestStl):
    name = "3mf"


class TestPly(WithoutImages):
    name = "ply"

    def test_its_cameras_see_what_the_orthographic_ones_see(self, plain_project, exported):
        """No cameras: the points are those of the model, with outward normals and their sigma."""
        open3d = pytest.importorskip("open3d")
        cloud = open3d.t.io.read_point_cloud(str(exported[0] / "points.ply"))
        points = cloud.point.positions.numpy()
        model = read_model(plain_project / "sparse" / "0")
        nearest = np.abs(points[:, None] - model.points[None]).max(axis=2).min(axis=1)
        assert nearest.max() < 1e-6
        radial = points / np.linalg.norm(points, axis=1, keepdims=True)
        cosine = np.sum(cloud.point.normals.numpy() * radial, axis=1)
        assert np.median(cosine) > 0.99
        assert cosine.min() > 0.0
        sigma = cloud.point["sigma"].numpy().ravel()
        # 0.1 px of noise: below a px in every direction seen from two sides or more
        assert 0.02 < np.median(sigma) * 20 / 0.05 < 1.0


def test_the_manual_describes_every_format() -> None:
    text = (Path(__file__).parents[2] / "docs" / "exports.md").read_text(encoding="utf-8")
    rows = [line.split("`")[1] for line in text.splitlines() if line.startswith("| `")]
    assert [name for name in rows if name in FORMATS] == list(FORMATS)


def test_every_module_of_formats_is_registered() -> None:
    modules = {path.stem for path in Path(formats.__file__).parent.glob("[!_]*.py")}
    assert {entry.module.rsplit(".", 1)[1] for entry in FORMATS.values()} == modules


def test_every_format_has_a_contract() -> None:
    tested: set[str] = set()
    pending = ExportContract.__subclasses__()
    while pending:
        kind = pending.pop()
        pending += kind.__subclasses__()
        tested.add(getattr(kind, "name", ""))
    assert tested >= set(FORMATS)
