"""Small independent readers of what is exported, written from each program's documentation.

COLMAP: https://colmap.github.io/format.html. OpenMVS: InterfaceCOLMAP reads tokens separated by
white space and PINHOLE only. gsplat and OpenSplat: ``images/`` and ``sparse/0/*.bin``. nerfstudio:
docs "Data conventions". Bundler: its manual, section "Output format". NVM: VisualSFM's
documentation. None of them uses pycolmap or the package under test.
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

PINHOLES = {0: ("SIMPLE_PINHOLE", 3), 1: ("PINHOLE", 4)}


@dataclass
class View:
    """A camera as a consumer would build it."""

    name: str
    size: tuple[int, int]
    K: np.ndarray
    R: np.ndarray
    t: np.ndarray
    xy: np.ndarray
    point_ids: np.ndarray

    def project(self, points: np.ndarray) -> np.ndarray:
        x = (points @ self.R.T + self.t) @ self.K.T
        return x[:, :2] / x[:, 2:]


@dataclass
class Scene:
    views: dict[str, View]
    points: dict[int, np.ndarray]


def rotation(q: np.ndarray) -> np.ndarray:
    """COLMAP's quaternion w x y z."""
    w, x, y, z = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def matrix(model: str, params: list[float] | np.ndarray) -> np.ndarray:
    fx, fy, cx, cy = (params[0], *params) if model == "SIMPLE_PINHOLE" else params
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])


def read_binary(folder: Path) -> Scene:
    """cameras.bin, images.bin, points3D.bin, as gsplat's, OpenSplat's and Inria's loaders do."""

    class Bytes:
        def __init__(self, path: Path) -> None:
            self.data, self.at = path.read_bytes(), 0

        def take(self, form: str) -> tuple:
            values = struct.unpack_from("<" + form, self.data, self.at)
            self.at += struct.calcsize("<" + form)
            return values

        def text(self) -> str:
            end = self.data.index(b"\0", self.at)
            value, self.at = self.data[self.at : end].decode(), end + 1
            return value

    cameras, file = {}, Bytes(folder / "cameras.bin")
    for _ in range(file.take("Q")[0]):
        camera_id, model, width, height = file.take("iiQQ")
        assert model in PINHOLES, f"camera model {model} is no pinhole"
        name, num = PINHOLES[model]
        cameras[camera_id] = ((width, height), matrix(name, file.take(f"{num}d")))
    views, file = {}, Bytes(folder / "images.bin")
    for _ in range(file.take("Q")[0]):
        _, *pose, camera_id = file.take("I7dI")
        name = file.text()
        num = file.take("Q")[0]
        rows = np.array(file.take("ddq" * num), dtype=object).reshape(-1, 3)
        size, K = cameras[camera_id]
        views[name] = View(
            name, size, K, rotation(np.array(pose[:4])), np.array(pose[4:]),
            rows[:, :2].astype(float), rows[:, 2].astype(np.int64),
        )  # fmt: skip
    points, file = {}, Bytes(folder / "points3D.bin")
    for _ in range(file.take("Q")[0]):
        point_id, *xyz = file.take("Q3d")
        file.take("3Bd")
        file.take("II" * file.take("Q")[0])
        points[point_id] = np.array(xyz)
    return Scene(views, points)


def read_text(folder: Path, *, models: tuple[str, ...] = ("PINHOLE", "SIMPLE_PINHOLE")) -> Scene:
    """cameras.txt, images.txt, points3D.txt, fields separated by white space."""

    def lines(name: str) -> list[str]:
        text = (folder / name).read_text(encoding="utf-8").split("\n")
        return [line for line in text if not line.startswith("#")]

    cameras = {}
    for line in filter(None, lines("cameras.txt")):
        camera_id, model, width, height, *params = line.split()
        assert model in models, f"{model} is not accepted"
        K = matrix(model, [float(p) for p in params])
        cameras[camera_id] = ((int(width), int(height)), K)
    views = {}
    rows = lines("images.txt")
    for head, tail in zip(rows[0::2], rows[1::2], strict=False):
        if not head:
            continue
        _, *pose, camera_id, name = head.split()
        p = np.array([float(v) for v in pose])
        table = np.array(tail.split(), dtype=float).reshape(-1, 3)
        size, K = cameras[camera_id]
        views[name] = View(
            name, size, K, rotation(p[:4]), p[4:], table[:, :2], table[:, 2].astype(np.int64)
        )
    points = {}
    for line in filter(None, lines("points3D.txt")):
        point_id, x, y, z, *_ = line.split()
        points[int(point_id)] = np.array([float(x), float(y), float(z)])
    return Scene(views, points)


def _from_tracks(
    cameras: list[tuple[str, np.ndarray, np.ndarray, np.ndarray]],
    tracks: list[tuple[np.ndarray, list[tuple[int, float, float]]]],
) -> Scene:
    seen: list[list[tuple[float, float, int]]] = [[] for _ in cameras]
    for j, (_, measured) in enumerate(tracks):
        for i, x, y in measured:
            seen[i].append((x, y, j))
    views = {}
    for (name, K, R, t), rows in zip(cameras, seen, strict=True):
        table = np.array(rows).reshape(-1, 3)
        views[name] = View(name, (0, 0), K, R, t, table[:, :2], table[:, 2].astype(np.int64))
    return Scene(views, {j: xyz for j, (xyz, _) in enumerate(tracks)})


def read_bundler(folder: Path) -> Scene:
    """bundle.out: y up, the camera looks along -z, measurements from the image centre."""
    names = (folder / "bundle.list.txt").read_text(encoding="utf-8").splitlines()
    head, *rest = (folder / "bundle.out").read_text().splitlines()
    assert head == "# Bundle file v0.3"
    num_cameras, num_points = (int(v) for v in rest[0].split())
    assert len(names) == num_cameras
    values = " ".join(rest[1:]).split()
    at = 0

    def take(num: int) -> np.ndarray:
        nonlocal at
        at += num
        return np.array(values[at - num : at], dtype=float)

    cameras = []
    for name in names:
        f, k1, k2 = take(3)
        assert k1 == k2 == 0
        # p = -P / P_z and x' = f p, with y up: K for y up and z toward the viewer
        K = np.diag([-f, -f, 1.0])
        cameras.append((name, K, take(9).reshape(3, 3), take(3)))
    tracks = []
    for _ in range(num_points):
        xyz = take(3)
        take(3)
        rows = take(4 * int(take(1)[0])).reshape(-1, 4)
        tracks.append((xyz, [(int(i), x, y) for i, _, x, y in rows]))
    assert at == len(values)
    return _from_tracks(cameras, tracks)


def read_nvm(folder: Path) -> Scene:
    """model.nvm: rotation w x y z from world to camera, camera centre, centred measurements."""
    text = (folder / "model.nvm").read_text(encoding="utf-8")
    lines = [line for line in text.split("\n") if line.strip()]
    assert lines[0] == "NVM_V3 "  # with the blank that MeshLab looks for
    num = int(lines[1])
    cameras = []
    for line in lines[2 : 2 + num]:
        name, *values = line.split()
        f, *pose, radial, end = (float(v) for v in values)
        assert radial == end == 0
        R = rotation(np.array(pose[:4]))
        cameras.append((name, np.diag([f, f, 1.0]), R, -R @ np.array(pose[4:])))
    tracks = []
    count = int(lines[2 + num])
    for line in lines[3 + num : 3 + num + count]:
        v = line.split()
        rows = np.array(v[7:], dtype=float).reshape(-1, 4)
        assert len(rows) == int(v[6])
        tracks.append((np.array(v[:3], dtype=float), [(int(i), x, y) for i, _, x, y in rows]))
    return _from_tracks(cameras, tracks)


def read_transforms(folder: Path) -> tuple[dict[str, View], float]:
    """transforms.json: camera to world, x right, y up, looking along -z; and the world's scale."""
    data = json.loads((folder / "transforms.json").read_text(encoding="utf-8"))
    assert data["camera_model"] in ("OPENCV", "PINHOLE")
    views = {}
    for frame in data["frames"]:
        assert (folder / frame["file_path"]).is_file()
        pose = np.array(frame["transform_matrix"])
        assert pose.shape == (4, 4)
        assert np.allclose(pose[3], [0, 0, 0, 1])
        assert np.linalg.det(pose[:3, :3]) > 0.999
        R = np.diag([1.0, -1.0, -1.0]) @ pose[:3, :3].T
        K = matrix("PINHOLE", [frame[k] for k in ("fl_x", "fl_y", "cx", "cy")])
        name = frame["file_path"].removeprefix("images/")
        none = np.zeros((0, 2))
        size = (frame["w"], frame["h"])
        views[name] = View(name, size, K, R, -R @ pose[:3, 3], none, np.zeros(0, dtype=int))
    assert (folder / data["ply_file_path"]).is_file()
    return views, float(data["semsfm_world_scale"])


def splatting_folder(folder: Path) -> Scene:
    """What gsplat's example loader and OpenSplat ask of a folder.

    ``sparse/0`` (or ``sparse``) with the three .bin files, pinhole cameras only, every image of the
    model in ``images/`` and the sorted lists of both equally long, sizes as stated.
    """
    scene = read_binary(folder / "sparse" / "0")
    on_disk = sorted(
        str(p.relative_to(folder / "images")) for p in (folder / "images").rglob("*") if p.is_file()
    )
    assert on_disk == sorted(scene.views)
    assert len(scene.points) > 0
    for view in scene.views.values():
        assert image_size(folder / "images" / view.name) == view.size
    return scene


def openmvs_folder(folder: Path) -> Scene:
    """What InterfaceCOLMAP asks: text below sparse/ without 0, PINHOLE only, no empty track."""
    scene = read_text(folder / "sparse", models=("PINHOLE",))
    for view in scene.views.values():
        assert (folder / "images" / view.name).is_file()
    seen = {int(j) for view in scene.views.values() for j in view.point_ids if j >= 0}
    assert seen == set(scene.points)
    return scene


def image_size(path: Path) -> tuple[int, int]:
    """Width and height as the file says."""
    import PIL.Image

    with PIL.Image.open(path) as image:
        return image.size


def read_colmap_map(path: Path) -> np.ndarray:
    """COLMAP's scripts/python/read_write_dense.py: Fortran order of (width, height, channels)."""
    with path.open("rb") as file:
        data = file.read()
    head = b"&".join(data.split(b"&", 3)[:3]) + b"&"
    width, height, channels = (int(v) for v in head.split(b"&")[:3])
    values = np.frombuffer(data[len(head) :], dtype=np.float32)
    return np.transpose(values.reshape((width, height, channels), order="F"), (1, 0, 2)).squeeze()
