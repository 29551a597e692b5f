"""What `semsfm view` shows of a project at a moment, made again when its files have changed."""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from semsfm_colmap.errors import InputError, SemSfmError
from semsfm_colmap.metrology.sizes.options import MetrologyOptions
from semsfm_colmap.pipeline.measure import errors_of
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.specimen import read_specimen

if TYPE_CHECKING:
    from semsfm_colmap.metrology.sizes.budget import Measurement
    from semsfm_colmap.metrology.sizes.covariance import Errors
    from semsfm_colmap.metrology.sizes.specimen import Specimen
    from semsfm_colmap.report.inputs import ReportInputs

WAITING = "no model yet: this page shows the points as soon as `semsfm map` has written them"
MODEL_FILES = ("cameras.bin", "images.bin", "points3D.bin", "orthographic.json")


@dataclass(frozen=True, kw_only=True)
class Shown:
    """A packed scene."""

    stamp: str
    """of the files that it was made from"""
    packed: bytes
    remark: str
    """a sentence for who looks at it; empty: none"""


class ProjectView:
    """A project as it is on the disk; several threads may ask at a time."""

    def __init__(self, project: Project, options: MetrologyOptions) -> None:
        self.project = project
        self.options = options
        self._lock = threading.Lock()
        self._shown: Shown | None = None
        self._specimen: tuple[str, Specimen] | None = None
        self._errors: tuple[str, Errors] | None = None

    @property
    def title(self) -> str:
        """The project's name."""
        return self.project.path.resolve().name

    def stamp(self) -> str:
        """Of all files that the scene is made from: another one when one of them has changed."""
        project = self.project
        files = [project.sparse / "0" / name for name in MODEL_FILES]
        files += [project.series, project.dense / "fused.ply", project.segments / "mesh.ply"]
        files += [project.mesh / name for name in ("mesh.ply", "mesh.glb")]
        return ";".join(_stamp_of(file) for file in files)

    def scene(self) -> Shown:
        """The scene of the files as they are.

        Raises
        ------
        InputError
            There is no model yet.

        """
        with self._lock:
            stamp = self.stamp()
            if self._shown is None or self._shown.stamp != stamp:
                self._shown = self._make(stamp)
            return self._shown

    def picture(self, image: int) -> bytes:
        """A prepared image of the model as PNG, by its number.

        Raises
        ------
        InputError
            There is none.

        """
        from semsfm_colmap.io.grey import read_grey
        from semsfm_colmap.report.viewer.pictures import encoded

        with self._lock:
            names = self._read_specimen().model.image_names
        if not 0 <= image < len(names):
            raise InputError(f"the model has images 0 to {len(names) - 1}, not {image}")
        return encoded(read_grey(self.project.images / names[image]), lossless=True)[0]

    def measure(self, vertices: list[int]) -> dict[str, Any]:
        """What `semsfm measure --points vertex:A vertex:B` gives, as the page shows it.

        Raises
        ------
        InputError
            Not two or three vertices, or one is not there.

        """
        from semsfm_colmap.metrology.sizes.requests import (
            MeasurementRequest,
            PlaceRequest,
            Requests,
        )
        from semsfm_colmap.metrology.sizes.run import measure

        if len(vertices) not in (2, 3):
            raise InputError(f"a length takes 2 places and an angle 3, not {len(vertices)}")
        places = tuple(PlaceRequest(vertex=vertex) for vertex in vertices)
        asked = [MeasurementRequest(name="length", kind="distance", places=places[:2])]
        if len(places) == 3:
            asked.append(
                MeasurementRequest(name="angle at the second", kind="angle", places=places)
            )
        with self._lock:
            specimen = self._read_specimen()
            specimen.check_one_world()
            found, _ = measure(
                specimen, self._read_errors(specimen), Requests(measurements=tuple(asked))
            )
        not_assessed = list(dict.fromkeys(word for one in found for word in one.not_assessed))
        return {"values": [_plain(one) for one in found], "not_assessed": not_assessed}

    def _make(self, stamp: str) -> Shown:
        from semsfm_colmap.pipeline.viewer_inputs import viewer_inputs
        from semsfm_colmap.report.viewer.scene import build_scene

        if not (self.project.sparse / "0" / "points3D.bin").is_file():
            raise InputError(WAITING)
        remark, specimen = "", None
        try:
            specimen = self._read_specimen()
            specimen.check_one_world()
        except InputError as error:
            specimen = None
            remark = f"the surface is not shown: {error}"
        inputs = self._inputs(specimen)
        viewer = viewer_inputs(self.project, specimen)
        scene = build_scene(replace(inputs, viewer=viewer), live=True)
        if scene is None:
            raise InputError("the model holds nothing that can be shown")
        return Shown(stamp=stamp, packed=scene.packed, remark=remark)

    def _inputs(self, specimen: Specimen | None) -> ReportInputs:
        from semsfm_colmap.io.ply import read_ply_cloud
        from semsfm_colmap.report.inputs import ReportInputs
        from semsfm_colmap.types import SemSeries

        project = self.project
        model = project.read_main_model() if specimen is None else specimen.model
        cloud = project.dense / "fused.ply"
        return ReportInputs(
            reconstruction=model,
            series=project.read_series() if project.series.is_file() else SemSeries(frames=()),
            mesh=None if specimen is None else specimen.mesh,
            cloud=read_ply_cloud(cloud) if cloud.is_file() else None,
            title=self.title,
        )

    def _read_specimen(self) -> Specimen:
        stamp = self.stamp()
        if self._specimen is None or self._specimen[0] != stamp:
            try:
                self._specimen = (stamp, read_specimen(self.project))
            except SemSfmError:
                raise
            except (OSError, ValueError) as error:
                # a stage is just writing: the next time the page asks it is there
                raise InputError(f"the model cannot be read at the moment ({error})") from error
        return self._specimen[1]

    def _read_errors(self, specimen: Specimen) -> Errors:
        stamp = self.stamp()
        if self._errors is None or self._errors[0] != stamp:
            self._errors = (stamp, errors_of(self.project, specimen, self.options))
        return self._errors[1]


def _plain(one: Measurement) -> dict[str, Any]:
    """A measurement as the page's script reads it."""
    from semsfm_colmap.report.html_measurements import unit_text

    return {
        "name": one.name,
        "value": one.value,
        "sigma": one.sigma,
        "unit": unit_text(one.unit),
        "sources": [[source.name, source.contribution] for source in one.sources],
        "remarks": list(one.remarks),
    }


def _stamp_of(path: Path) -> str:
    try:
        found = path.stat()
    except OSError:
        return "-"
    return f"{found.st_mtime_ns:x}.{found.st_size:x}"
