"""The types that travel between the stages: small, immutable, arrays read-only.

Indices: image i < M, track j < N, observation row o < O. Coordinates ``xy`` are in px with
COLMAP's origin (the centre of the first pixel is (0.5, 0.5)), x right, y down, z away from the
viewer. Angles are radians. Units stand in the names: ``_px _um _rad _deg``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Generic, Literal, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from semsfm_colmap.reprs import outline

Array = NDArray[Any]
Float = NDArray[np.float64]
Int = NDArray[np.int64]
Bool = NDArray[np.bool_]

T = TypeVar("T")
A = TypeVar("A")
B = TypeVar("B")


class ParallelMap(Protocol):
    """Apply a function to items, results in their order; the builtin `map` is one."""

    def __call__(self, function: Callable[[A], B], items: Iterable[A], /) -> Iterator[B]: ...  # noqa: D102


class _Frozen:
    """Make every array field read-only after construction; shown as an outline."""

    def __init_subclass__(cls) -> None:
        cls.__repr__ = outline  # type: ignore[method-assign]  # dataclass keeps what is there

    def __post_init__(self) -> None:
        for f in fields(self):  # type: ignore[arg-type]
            value = getattr(self, f.name)
            if isinstance(value, np.ndarray) and value.flags.writeable:
                view = value.view()
                view.flags.writeable = False
                object.__setattr__(self, f.name, view)


@dataclass(frozen=True, kw_only=True, eq=False)
class SemMetadata:
    """What the microscope recorded with an image; None where it recorded nothing."""

    pixel_size_um: float | None = None
    tilt_rad: float | None = None
    tilt_axis_rad: float | None = None
    """Direction of the tilt axis in the image, from x toward y."""
    stage_rotation_rad: float | None = None
    scan_rotation_rad: float | None = None
    stage_xyz_um: tuple[float, float, float] | None = None
    working_distance_um: float | None = None
    beam_energy_kev: float | None = None
    magnification: float | None = None
    instrument: str | None = None
    detector: str | None = None
    tilt_corrected: bool | None = None
    displacement_um: float | None = None
    """Of the actuator that turned the specimen, e.g. the elongation of a helical nanobelt."""
    source: Mapping[str, str] = field(default_factory=dict)
    """For each recorded field, where its value came from, e.g. "CZ_SEM AP_IMAGE_PIXEL_SIZE"."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SemFrame:
    """One prepared image on disk: its name below PROJECT/images and what is known about it."""

    name: str
    width_px: int
    height_px: int
    source_path: str
    crop_px: tuple[int, int, int, int]
    """(x0, y0, x1, y1) of the prepared image in the source image."""
    metadata: SemMetadata = field(default_factory=SemMetadata)
    warnings: tuple[str, ...] = ()
    databar: bool = False
    """True where a databar was found and cut off."""
    series: str = ""
    """Which of several series that were merged it is from."""

    @property
    def scanned(self) -> bool:
        """Whether a databar or what a header records shows a scanning microscope."""
        m = self.metadata
        recorded = (m.instrument, m.beam_energy_kev, m.working_distance_um, m.scan_rotation_rad)
        return self.databar or any(value is not None for value in recorded)


@dataclass(frozen=True, kw_only=True, eq=False)
class SemSeries:
    """The prepared images in acquisition order and the pixel size of the series."""

    __repr__ = outline

    frames: tuple[SemFrame, ...]
    pixel_size_um: float | None = None
    pixel_size_source: str = "none"
    warnings: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Image names in acquisition order."""
        return tuple(frame.name for frame in self.frames)

    def recorded(self, quantity: str, names: Sequence[str] | None = None) -> Float:
        """A number of the metadata of the images, nan where none is.

        Parameters
        ----------
        quantity : a field of `SemMetadata`
        names : of some images, in that order; default: all

        Returns
        -------
        (M,)

        """
        value = {frame.name: getattr(frame.metadata, quantity) for frame in self.frames}
        said = [value.get(name) for name in (self.names if names is None else names)]
        return np.array([np.nan if v is None else v for v in said], dtype=np.float64)

    @property
    def series_names(self) -> tuple[str, ...]:
        """The series that were merged into this one, in their order; one, mostly without a name."""
        return tuple(dict.fromkeys(frame.series for frame in self.frames))

    @property
    def series_idx(self) -> Int:
        """(M,) for each image its place in `series_names`."""
        number = {name: k for k, name in enumerate(self.series_names)}
        return np.array([number[frame.series] for frame in self.frames], dtype=np.int64)

    @property
    def series_pixel_sizes_um(self) -> tuple[float | None, ...]:
        """Pixel size of each of `series_names` by its images."""
        size = {frame.series: frame.metadata.pixel_size_um for frame in self.frames}
        return tuple(size[name] for name in self.series_names)


@dataclass(frozen=True, kw_only=True, eq=False)
class Features(_Frozen):
    """Keypoints of one image, K of them."""

    xy: Float
    scale_px: Float
    angle_rad: Float
    affine_shape: Float
    """(K, 2, 2): maps the unit circle of the normalised patch to the image, in px."""
    response: Float
    detector_id: Int
    descriptors: Array
    """(K, D)"""


@dataclass(frozen=True, kw_only=True, eq=False)
class AffineTwoViewGeometry(_Frozen):
    """Matches of one image pair and the affine epipolar geometry they agree on."""

    image_pair: tuple[int, int]
    keypoints: Int
    """(L, 2) keypoint indices, one match a row."""
    F: Float | None
    """(3, 3), upper-left 2 x 2 block zero; None when no geometry was found."""
    inlier: Bool
    residual_px: Float
    """(L,) signed distance to the epipolar constraint; nan without F."""
    rejected_by: Mapping[str, int] = field(default_factory=dict)
    """How many matches each filter dropped."""
    failure: str | None = None
    step: Int | None = None
    """(L,) places in `records.MATCH_STEPS`: the filter that dropped each, the last for inliers"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Observations(_Frozen):
    """Image measurements of tracks in coordinate (COO) form, sorted by track, then image."""

    image_idx: Int
    track_idx: Int
    keypoint_idx: Int
    xy: Float
    num_images: int
    num_tracks: int
    relative_sigma: Float | None = None
    """(O,) standard deviation of each in units of the series' noise; None: all alike"""

    def __len__(self) -> int:
        return len(self.image_idx)

    @property
    def precision(self) -> Float:
        """(O,) weights ``1 / relative_sigma^2``."""
        if self.relative_sigma is None:
            return np.ones(len(self))
        return np.asarray(1.0 / np.square(self.relative_sigma))

    def select(self, rows: Array) -> Observations:
        """Some of the observations; images and tracks keep their numbers.

        Parameters
        ----------
        rows : (O,) bool, or indices of the observations

        """
        return replace(
            self,
            image_idx=self.image_idx[rows],
            track_idx=self.track_idx[rows],
            keypoint_idx=self.keypoint_idx[rows],
            xy=self.xy[rows],
            relative_sigma=None if self.relative_sigma is None else self.relative_sigma[rows],
        )

    def measurement_matrix(self) -> Float:
        """The paper's M, (2 M, N), nan where a track is not seen: for small problems and tests.

        Examples
        --------
        Track 0 in both images, track 1 in the second one alone:

        >>> observations = Observations(
        ...     track_idx=np.array([0, 0, 1]),
        ...     image_idx=np.array([0, 1, 1]),
        ...     keypoint_idx=np.array([7, 3, 4]),
        ...     xy=np.array([[10.5, 20.5], [11.5, 21.5], [50.5, 60.5]]),
        ...     num_images=2,
        ...     num_tracks=2,
        ... )
        >>> observations.measurement_matrix()
        array([[10.5,  nan],
               [20.5,  nan],
               [11.5, 50.5],
               [21.5, 60.5]])

        """
        matrix = np.full((self.num_images, 2, self.num_tracks), np.nan)
        matrix[self.image_idx, :, self.track_idx] = self.xy
        return matrix.reshape(2 * self.num_images, self.num_tracks)


@dataclass(frozen=True, kw_only=True, eq=False)
class AffineModel(_Frozen):
    """``xy = A[i] @ X[j] + t[i]``, determined up to a 3-D affinity."""

    A: Float
    t: Float
    X: Float


@dataclass(frozen=True, kw_only=True, eq=False)
class OrthographicCameras(_Frozen):
    """``xy = scale[i] * K2 @ (cam_from_world[i] @ X)[:2] + translation[i]``.

    ``K2 = [[1, skew], [0, aspect]]`` is shared by all images.
    """

    cam_from_world: Float
    """(M, 3, 3) rotations"""
    scale_px_per_unit: Float
    """(M,)"""
    translation_px: Float
    """(M, 2)"""
    aspect: float = 1.0
    skew: float = 0.0
    series_idx: Int | None = None
    """(M,) which of several merged series an image is from: the magnifications of one are nearly
    alike, whatever those of the others are; None: all are of one series"""

    def __len__(self) -> int:
        return len(self.scale_px_per_unit)

    @property
    def num_series(self) -> int:
        """Series that have an image."""
        return 1 if self.series_idx is None else len(np.unique(self.series_idx))

    @property
    def mean_scale_px_per_unit(self) -> float:
        """Geometric mean of the magnifications."""
        return float(np.exp(np.mean(np.log(self.scale_px_per_unit))))

    @property
    def common_scale(self) -> Float:
        """(M,) geometric mean of the magnifications of each image's series, over that of all."""
        log_scale = np.log(self.scale_px_per_unit)
        if self.series_idx is None:
            return np.ones(len(self))
        mean = np.bincount(self.series_idx, log_scale) / np.maximum(np.bincount(self.series_idx), 1)
        return np.asarray(np.exp(mean[self.series_idx] - log_scale.mean()))

    @property
    def K2(self) -> Float:
        """(2, 2) shared affine intrinsics."""
        return np.array([[1.0, self.skew], [0.0, self.aspect]])

    @property
    def projection(self) -> Float:
        """(M, 2, 3) the linear part ``scale * K2 @ cam_from_world[:2]``."""
        scaled = self.scale_px_per_unit[:, None, None] * (self.K2 @ self.cam_from_world[:, :2])
        return np.asarray(scaled, dtype=np.float64)

    @property
    def viewing_direction(self) -> Float:
        """(M, 3) unit vectors in the world, from the viewer into the scene."""
        return np.asarray(self.cam_from_world[:, 2])

    def project(self, points: Float, image_idx: Array) -> Float:
        """Project ``points[o]`` into image ``image_idx[o]``: (O, 3), (O,) -> (O, 2) px.

        Examples
        --------
        Two images of 10 px a unit, the second turned by 90 degrees about y: what lay in depth is
        to the right, and how far away it is makes no difference.

        >>> cameras = OrthographicCameras(
        ...     cam_from_world=np.array([np.eye(3), [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]]),
        ...     scale_px_per_unit=np.array([10.0, 10.0]),
        ...     translation_px=np.array([[100.0, 100.0], [100.0, 100.0]]),
        ... )
        >>> cameras.project(np.array([[1.0, 2.0, 3.0], [1.0, 2.0, 3.0]]), np.array([0, 1]))
        array([[110., 120.],
               [130., 120.]])

        """
        linear = np.einsum("oij,oj->oi", self.projection[image_idx], points)
        return np.asarray(linear + self.translation_px[image_idx])

    def select(self, image_idx: Array) -> OrthographicCameras:
        """The cameras of some images, in the order of `image_idx`."""
        return replace(
            self,
            cam_from_world=self.cam_from_world[image_idx],
            scale_px_per_unit=self.scale_px_per_unit[image_idx],
            translation_px=self.translation_px[image_idx],
            series_idx=None if self.series_idx is None else self.series_idx[image_idx],
        )


MOST_TOLD_CONFIDENCE = 0.99
"""No confidence in the hand above this was checked finely: 81 of 81 simulated scenes, and 294 of
294 with a known tilt, had the hand that was claimed with more (docs/depth_reversal.md)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthSign:
    """Which of the two depth-reversed solutions the evidence supports, and how strongly."""

    status: Literal["resolved", "ambiguous"]
    confidence: float
    """Probability that the model written first has the right hand, 0.5 to 1."""
    evidence: Mapping[str, float] = field(default_factory=dict)
    """For each cue, the probability it alone gives to the chosen hand."""
    message: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Reconstruction(_Frozen):
    """Cameras, points and their observations: what the mapping stage hands on.

    Images that could not be registered are not in it. Observations that some filter rejected stay,
    with ``inlier`` False.
    """

    image_names: tuple[str, ...]
    image_size_px: Int
    """(M, 2) width, height"""
    cameras: OrthographicCameras
    points: Float
    """(N, 3) in world units"""
    observations: Observations
    inlier: Bool
    """(O,)"""
    point_color: Array | None = None
    """(N, 3) uint8"""
    point_covariance: Float | None = None
    """(N, 3, 3) in world units squared"""
    sigma_rotation_rad: Float | None = None
    """(M, 3) standard deviations about the camera's x, y, z"""
    sigma_translation_px: Float | None = None
    """(M, 2)"""
    sigma_scale: Float | None = None
    """(M,) relative"""
    world_unit: Literal["px", "um"] = "px"
    pixel_size_um: float | None = None
    pixel_size_source: str = "none"
    camera_model: str = "scaled_orthographic"
    depth_sign: DepthSign = field(
        default_factory=lambda: DepthSign(status="ambiguous", confidence=0.5)
    )
    gauge: str = ""
    drift_px: Float | None = None
    """(M, 2) scan drift that the images have and the observations have not: displacement in x and y
    of the last row against the first; None: nothing was taken out"""
    drag_px: float | None = None
    """Coefficient of the drag that the images have and the observations have not"""
    relief_px: float | None = None
    """Standard deviation in `point_covariance` of each point by itself along its normal."""

    @property
    def num_images(self) -> int:
        """The number of registered images, M."""
        return len(self.image_names)

    def residuals(self) -> Float:
        """(O, 2) px: predicted minus measured, for all observations."""
        obs = self.observations
        predicted = self.cameras.project(self.points[obs.track_idx], obs.image_idx)
        return np.asarray(predicted - obs.xy)

    def track_length(self) -> Int:
        """(N,) inlier observations of each point."""
        idx = self.observations.track_idx[self.inlier]
        return np.bincount(idx, minlength=len(self.points)).astype(np.int64)


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthMap(_Frozen):
    """Depth along the viewing direction for each pixel, nan where unknown."""

    image_name: str
    depth: Array
    """(H, W) float32, ``z`` of the camera frame in world units (world origin has depth 0)"""
    confidence: Array | None = None
    """(H, W) float32 in 0..1"""
    sigma: Array | None = None
    """(H, W) float32 standard deviation of the depth by the noise of its windows, world units"""


@dataclass(frozen=True, kw_only=True, eq=False)
class PointCloud(_Frozen):
    """Points (N, 3) with optional unit normals (toward the viewer) and grey or rgb colours."""

    points: Float
    normals: Float | None = None
    colors: Array | None = None
    """(N, 3) uint8"""
    sigma: Array | None = None
    """(N,) standard deviation in world units"""

    def select(self, keep: Array) -> PointCloud:
        """The points that `keep`, a mask or an index array, names."""
        return PointCloud(
            points=self.points[keep],
            normals=None if self.normals is None else self.normals[keep],
            colors=None if self.colors is None else self.colors[keep],
            sigma=None if self.sigma is None else self.sigma[keep],
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class TriangleMesh(_Frozen):
    """Vertices (V, 3) in world units, faces (F, 3), counter-clockwise seen from outside."""

    vertices: Float
    faces: Int
    vertex_normals: Float | None = None
    vertex_colors: Array | None = None
    """(V, 3) uint8"""
    vertex_sigma: Array | None = None
    """(V,) standard deviation along the normal in world units"""
    face_filled: Bool | None = None
    """(F,) True where a face closes a hole: nobody saw what it shows"""
    uv: Float | None = None
    """(F, 3, 2) texture coordinates, origin bottom left"""
    texture: Array | None = None
    """(H, W, 3) uint8"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Solution(Generic[T]):
    """What a solver returns: the value, or the reason there is none.

    ``status`` is "ok" or a short name of the failure; ``message`` says it in a sentence, with what
    to try. ``costs`` holds the cost after each iteration.
    """

    value: T | None
    status: str = "ok"
    message: str = ""
    iterations: int = 0
    costs: tuple[float, ...] = ()
    diagnostics: Mapping[str, Any] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """True when there is a value to go on with."""
        return self.value is not None
