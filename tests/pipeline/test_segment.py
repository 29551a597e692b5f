import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from semsfm_colmap.cli.main import main
from semsfm_colmap.colmap.model.sparse import read_model
from semsfm_colmap.config import Config
from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.geometry.alignment import Similarity
from semsfm_colmap.geometry.normals import sampling_distance
from semsfm_colmap.io.ply import read_ply_cloud, read_ply_file, read_ply_mesh
from semsfm_colmap.pipeline.runner import run_stages
from semsfm_colmap.pipeline.segment import segment_project
from semsfm_colmap.segmentation.cut_file import read_cuts
from semsfm_colmap.segmentation.cuts import Cut
from semsfm_colmap.segmentation.files import select_part
from semsfm_colmap.segmentation.options import SegmentationOptions


@pytest.fixture
def project(small_project, tmp_path):
    return shutil.copytree(small_project, tmp_path / "p")


@pytest.fixture(scope="module")
def segmented(small_project, tmp_path_factory):
    """A project with its parts; not to be changed."""
    copy = shutil.copytree(small_project, tmp_path_factory.mktemp("segmented") / "p")
    segment_project(copy)
    return copy


def names_of(path):
    table = json.loads((path / "segments" / "segments.json").read_text())
    return {part["name"]: part for part in table["parts"]}


def label_of(path, name="fused.ply"):
    return read_ply_file(path / "segments" / name).vertices["label"]


def test_a_grain_on_a_stalk_is_told_from_it_and_the_table_adds_up(segmented):
    parts = names_of(segmented)
    assert set(parts) == {"specimen", "stalk"}
    mesh = read_ply_mesh(segmented / "mesh" / "mesh.ply")
    cloud = read_ply_cloud(segmented / "dense" / "fused.ply")
    assert sum(part["num_faces"] for part in parts.values()) == len(mesh.faces)
    assert sum(part["num_points"] for part in parts.values()) == len(cloud.points)
    assert parts["specimen"]["area"] > 4 * parts["stalk"]["area"] > 0


@pytest.mark.parametrize(
    ("copy", "source"),
    [
        ("fused.ply", "dense/fused.ply"),
        ("mesh.ply", "mesh/mesh.ply"),
        ("points.ply", "sparse/0/points.ply"),
    ],
)
def test_copies_hold_all_of_the_original_and_a_label(copy, source, segmented, small_project):
    made, old = read_ply_file(segmented / "segments" / copy), read_ply_file(segmented / source)
    assert made.vertices.dtype.names == (*old.vertices.dtype.names, "label")
    for name in old.vertices.dtype.names:
        np.testing.assert_array_equal(made.vertices[name], old.vertices[name])
    assert (made.faces is None) == (old.faces is None)
    # the original is as it was
    assert (segmented / source).read_bytes() == (small_project / source).read_bytes()


def test_other_programs_read_the_copies(segmented):
    import trimesh

    from semsfm_colmap.io.open3d_library import import_open3d

    path = segmented / "segments" / "mesh.ply"
    mesh = read_ply_mesh(path)
    assert len(trimesh.load(path, process=False).faces) == len(mesh.faces)
    o3d = import_open3d()
    assert len(o3d.io.read_triangle_mesh(str(path)).triangles) == len(mesh.faces)
    cloud = o3d.t.io.read_point_cloud(str(segmented / "segments" / "fused.ply"))
    assert np.array_equal(cloud.point["label"].numpy().ravel(), label_of(segmented))


def test_the_picture_is_one(segmented):
    import cv2

    assert cv2.imread(str(segmented / "segments" / "segments.png")).shape[2] == 3


def test_masks_go_back_into_extract_and_leave_features_on_the_specimen(
    segmented, small_series, tmp_path
):
    import cv2

    from semsfm_colmap.colmap.database.work import read_images, read_keypoints
    from semsfm_colmap.config import IngestOptions

    folder = segmented / "segments" / "masks"
    config = Config(ingest=IngestOptions(masks_path=folder))
    run_stages(
        tmp_path / "p", config, names=("ingest", "extract"), image_path=small_series / "images"
    )
    database = tmp_path / "p" / "database.db"
    for image in read_images(database):
        mask = cv2.imread(str(folder / f"{image.name}.png"), cv2.IMREAD_GRAYSCALE)
        xy = read_keypoints(database, [image.image_id])[image.image_id][:, :2]
        column, row = np.floor(xy).astype(int).T
        assert len(xy) > 100
        assert np.all(mask[row, column] > 0)


def test_a_part_is_meshed_alone(project):
    before = read_ply_mesh(project / "mesh" / "mesh.ply")
    assert main(["segment", str(project), "-q"]) == 0
    assert main(["mesh", str(project), "--segment", "specimen", "-q"]) == 0
    mesh = read_ply_mesh(project / "mesh" / "mesh.ply")
    assert 0 < len(mesh.faces) < len(before.faces)
    cloud = read_ply_cloud(project / "dense" / "fused.ply")
    stalk = select_part(cloud, project / "segments", "stalk").points
    spacing = sampling_distance(cloud.points)

    def far(surface):
        return np.quantile(cKDTree(surface.vertices).query(stalk)[0], 0.99)

    # the end of the stalk was in the mesh, and is far from what is left
    assert far(before) < 4 * spacing
    assert far(mesh) > 8 * spacing
    # with the same labels there is nothing to do, with others there is
    record = run_stages(project, with_part("specimen"), names=("mesh",))
    first = record.entry("mesh").key
    segment_project(project, new_cuts=[Cut(kind="plane", values=(1.0, 0.0, 0.0, 0.0))])
    assert run_stages(project, with_part("specimen"), names=("mesh",)).entry("mesh").key != first


def with_part(name):
    return Config(segmentation=SegmentationOptions(part=name))


def test_without_a_segmentation_the_mesh_stage_says_what_to_run(project, capsys):
    main(["mesh", str(project), "--segment", "specimen"])
    said = capsys.readouterr()
    assert "segments.json is missing: run `semsfm segment" in said.out + said.err


def test_a_part_that_is_not_there_is_named(segmented):
    cloud = read_ply_cloud(segmented / "dense" / "fused.ply")
    with pytest.raises(InputError, match=r"no part named coil: the parts are specimen, stalk"):
        select_part(cloud, segmented / "segments", "coil")


def test_labels_of_another_cloud_are_refused(segmented):
    cloud = read_ply_cloud(segmented / "dense" / "fused.ply")
    for other in (
        replace(cloud, points=cloud.points[:-1]),
        replace(cloud, points=cloud.points + 1.0),
    ):
        with pytest.raises(InputError, match="labels another cloud"):
            select_part(other, segmented / "segments", "specimen")


def test_cuts_are_kept_between_runs_and_taken_back(project):
    plain = label_of_run(project)
    assert main(["segment", str(project), "-q", "--plane", "1", "0", "0", "0"]) == 0
    cut = label_of(project)
    assert main(["segment", str(project), "-q"]) == 0
    assert np.array_equal(label_of(project), cut)
    x = read_ply_cloud(project / "dense" / "fused.ply").points[:, 0]
    assert np.array_equal(cut == 0, x > 0)
    centre = [str(c) for c in read_ply_cloud(project / "dense" / "fused.ply").points[0]]
    arguments = ["--sphere", *centre, "1", "--as_label", "core", "--keep", "core"]
    assert main(["segment", str(project), "-q", *arguments]) == 0
    assert [c.kind for c in read_cuts(project / "segments.toml")] == ["plane", "sphere", "keep"]
    for _ in range(3):
        assert main(["segment", str(project), "-q", "--undo"]) == 0
    assert np.array_equal(label_of(project), plain)
    assert len(label_of(project)) == len(x)


def label_of_run(path):
    segment_project(path)
    return label_of(path)


def test_a_cut_that_cannot_be_is_not_kept(project, capsys):
    assert main(["segment", str(project), "--drop", "halo"]) == 1
    assert "no part named halo" in capsys.readouterr().err
    assert main(["segment", str(project), "--sphere", "0", "0", "0", "-1"]) == 2
    assert not (project / "segments.toml").exists()
    assert not (project / "segments").exists()


def test_there_is_nothing_to_take_back_in_a_project_without_cuts(project):
    with pytest.raises(UsageError, match="0 cuts: 1 cannot be taken back"):
        segment_project(project, undo=1)


def test_before_densify_there_is_nothing_to_segment(project):
    shutil.rmtree(project / "dense")
    with pytest.raises(InputError, match="run `semsfm densify"):
        segment_project(project)


def test_a_project_without_a_mesh_has_parts_without_areas(project):
    shutil.rmtree(project / "mesh")
    table = segment_project(project)
    assert {part["area"] for part in table["parts"]} == {None}
    assert not (project / "segments" / "mesh.ply").exists()


def test_cuts_of_a_model_that_was_mapped_again_are_carried_over_or_refused(
    project, monkeypatch, capsys
):
    cloud = read_ply_cloud(project / "dense" / "fused.ply")
    centre, radius = cloud.points[0], 20 * sampling_distance(cloud.points)
    segment_project(project, new_cuts=[Cut(kind="sphere", values=(*centre, radius))])
    before = label_of(project)
    assert (before == 0).sum() > 20
    # the same in a world of another scale, turned and with the other hand
    turn = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    world = Similarity(rotation=turn @ np.diag([1.0, 1.0, -1.0]), scale=10.0, shift=np.ones(3))
    model = read_model(project / "sparse" / "0")
    cameras = model.cameras
    projection = cameras.cam_from_world @ world.rotation.T
    moved = replace(
        cameras,
        cam_from_world=np.diag([1.0, 1.0, -1.0]) @ projection,
        scale_px_per_unit=cameras.scale_px_per_unit / 10.0,
        translation_px=cameras.translation_px
        - np.einsum("mij,j->mi", cameras.projection @ world.rotation.T, world.shift) / 10.0,
    )
    there = replace(
        cloud, points=world.apply(cloud.points), normals=cloud.normals @ world.rotation.T
    )
    monkeypatch.setattr(
        "semsfm_colmap.pipeline.segment.read_surface",
        lambda _: (there, replace(model, cameras=moved)),
    )
    assert main(["segment", str(project)]) == 0
    assert "mapped again since cut 1 was made" in capsys.readouterr().err
    after = label_of(project)
    assert np.mean((after == 0) != (before == 0)) < 1e-3
    assert json.loads((project / "segments/segments.json").read_text())["notes"]
    # a new cut is in the new world, the old one stays in its own
    segment_project(project, new_cuts=[Cut(kind="plane", values=(1.0, 0.0, 0.0, 1e9))])
    first, second = read_cuts(project / "segments.toml")
    assert first.values == (*centre, radius)
    assert first.world != second.world
    path = project / "segments.toml"
    path.write_text(path.read_text().replace('image = "', 'image = "other_'))
    with pytest.raises(
        InputError, match=r"cut 1 \(sphere\) is in the coordinates of another model"
    ):
        segment_project(project)
    segment_project(project, undo=2)
    assert "world" not in path.read_text()
