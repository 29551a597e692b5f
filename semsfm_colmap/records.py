"""What stages leave behind: records, written to run.json and read by the report.

Plain frozen dataclasses of numbers, names and sentences; None stands for "not known". `to_plain`
gives what JSON holds, `from_plain` checks and reads it back; keys that this version does not know
are passed over, so that a record of an older or newer program can still be read.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal, TypeVar

R = TypeVar("R")


MATCH_STEPS = ("static background", "affine RANSAC", "distance filter", "verified")
"""What a match goes through, in this order; the last one is no filter."""


@dataclass(frozen=True, kw_only=True)
class PairStatistics:
    """What became of the matches of one image pair.

    Static background is dropped first, then the affine RANSAC and the distance filter act, so
    ``num_matches >= num_static_rejected + num_after_affine_ransac`` and
    ``num_after_affine_ransac >= num_after_distance_filter``.
    """

    image_name_1: str
    image_name_2: str
    num_matches: int
    """Descriptor matches, before any filter."""
    num_after_affine_ransac: int
    num_after_distance_filter: int
    """Verified matches, what the tracks are built from."""
    num_static_rejected: int = 0
    failure: str | None = None
    """Why the pair was rejected as a whole; None when it was kept."""

    @property
    def num_verified(self) -> int:
        """Matches that go on to the tracks: none of a rejected pair."""
        return 0 if self.failure is not None else self.num_after_distance_filter


@dataclass(frozen=True, kw_only=True)
class TrackCounts:
    """What became of the verified matches when they were joined."""

    num_tracks: int
    num_matches: int
    num_refused: int
    """would have put two places of an image into one track"""
    num_inconsistent: int = 0
    """contradicted by two other matches"""


@dataclass(frozen=True, kw_only=True)
class StartFigures:
    """How well the factorization held together."""

    num_blocks: int | None = None
    """complete blocks that constrain the cameras"""
    eigenvalues: tuple[float, ...] = ()
    """the smallest of the camera basis constraints; three are zero without noise"""
    eigenvalue_gap: float | None = None
    """the fourth over the third"""
    cbc_rms_px: float | None = None
    affine_rms_px: float | None = None
    affine_sigma_px: float | None = None
    num_segments: int | None = None
    """of a long series, which is factorized in pieces"""
    upgrade: UpgradeFigures | None = None


@dataclass(frozen=True, kw_only=True)
class UpgradeFigures:
    """The Euclidean upgrade: its linear system and its cost."""

    singular_values: tuple[float, ...]
    num_free: int
    """directions that the images do not determine"""
    indefinite: bool
    """True when the linear solution was no metric"""
    cost: float


@dataclass(frozen=True, kw_only=True)
class FilteringRound:
    """What one round of filtering left."""

    threshold_px: float
    num_observations: int
    num_points: int
    num_images: int
    sigma_px: float
    rms_px: float


@dataclass(frozen=True, kw_only=True)
class GuidedFigures:
    """What the guided second pass found."""

    num_passes: int
    high_pass_px: float
    num_places: int
    num_found: int
    num_observations_before: int
    num_observations: int
    mean_track_length_before: float
    mean_track_length: float
    sigma_before_px: float
    sigma_px: float
    largest_drift_px: float


@dataclass(frozen=True, kw_only=True)
class TiltAgreement:
    """Known tilts against the angles that the images show, and what came of them."""

    source: str
    consistent: bool
    factor: float | None
    """estimated over known, from a robust line; its sign is that of the axis"""
    tolerance: float | None
    """how far from 1 its size may lie"""
    stretch: float | None = None
    """by which all angles were multiplied"""
    weight: float | None = None
    """of the known tilts, 0 to 1"""
    sigma: float | None = None
    """one relative standard deviation of the angles after that"""


@dataclass(frozen=True, kw_only=True)
class Rung:
    """One camera model of the ladder, fitted."""

    name: str
    range_deg: float
    """largest rotation between two images"""
    bic: float
    held_out_px: float
    """root median square residual per coordinate at observations the fit has not seen; nan: none"""
    num_parameters: int


@dataclass(frozen=True, kw_only=True)
class LeftOut:
    """What leaving single images out does to the rotations of the others."""

    images: tuple[str, ...]
    change_deg: tuple[float, ...]
    """root mean square change for each"""
    jackknife_deg: float
    """standard deviation of a rotation from these changes"""


@dataclass(frozen=True, kw_only=True)
class HalfSeries:
    """Changes of the total rotation when half of the images are left out."""

    odd_deg: float
    even_deg: float
    difference_deg: float
    """between the halves; about twice the noise of the whole"""


@dataclass(frozen=True, kw_only=True)
class ScanDriftFigures:
    """The rung of the ladder with a drift within each frame."""

    largest_px: float
    best: bool
    """True when it explains the images best"""


@dataclass(frozen=True, kw_only=True)
class DragFigures:
    """How far shading drags features down the slopes."""

    coefficient_px: float
    sigma_px: float
    """in full"""
    formal_sigma_px: float
    """if all observations erred independently"""
    shading_px: tuple[float, ...] | None = None
    """Coefficients of the other fields of shading that were taken out with it, in the order of
    refinement/shading.py; None: of a single series none are sought"""


@dataclass(frozen=True, kw_only=True)
class SeriesSigma:
    """How well it is known how one of several series lies to the first; standard deviations."""

    turn_deg: float
    """of the angle between the two, root mean square over the three axes"""
    scale: float
    """of the ratio of their magnifications, relative"""


@dataclass(frozen=True, kw_only=True)
class PerspectiveFigures:
    """Perspective that a series has: rays that are not parallel, see docs/perspective.md."""

    kappa_per_px: float
    """inverse distance, in the hand that was chosen: an ordinary lens has a positive one"""
    sigma_per_px: float
    """its standard deviation"""
    distance_px: float
    """from the specimen, signed; the focal length of a pinhole camera that sees this"""
    distance_radii: float
    """the same in radii (root mean square) of the specimen"""
    deviation_px: float
    """from parallel projection at one radius in depth and one beside the axis"""
    change_deg: float
    """of the total rotation, against parallel projection"""
    used: bool
    """True when it was taken out of the observations"""
    principal_offset_px: tuple[float, float] = (0.0, 0.0)
    """of the place where the optical axis meets the images, from their middle"""
    principal_sigma_px: float | None = None
    """its standard deviation; None where the middle was taken"""


@dataclass(frozen=True, kw_only=True)
class Reliability:
    """How far to trust a model as a whole; in orthographic.json, metrics.json and run.json."""

    total_rotation_deg: float
    total_rotation_sigma_deg: float
    """with everything in it"""
    total_rotation_sigma_parts_deg: Mapping[str, float] | None = None
    """by cause: noise, clustered, drag, shading, models, and perspective where it was left in; None
    where no error bars can be given"""
    relief_px: float | None = None
    """Standard deviation of each point by itself along its normal, in the points' covariances."""
    drag: DragFigures | None = None
    """What was taken out of the observations for the shading, see docs/truth.md."""
    perspective: PerspectiveFigures | None = None
    """None where none was found"""
    series: tuple[SeriesSigma, ...] | None = None
    """Of several series each but the first; None where there is one, or no error bars"""
    depth_uncertainty: float
    """relative spread of the total rotation over the camera models that fit"""
    best_model: str
    models: tuple[Rung, ...]
    leave_one_out: LeftOut | None = None
    half_series: HalfSeries | None = None
    scan_drift: ScanDriftFigures | None = None
    drift_px: Mapping[str, tuple[float, float]] | None = None
    """What was taken out of the observations of each image: displacement in x and y of the last row
    against the first."""


@dataclass(frozen=True, kw_only=True)
class CueFigures:
    """One cue of the hand."""

    t: float
    """in standard deviations, positive for the model written first"""
    num_regions: int


@dataclass(frozen=True, kw_only=True)
class Diagnostics:
    """How one part of a series was mapped, for those who look into it."""

    sigma_px: float
    start: StartFigures
    depth_sign_cues: Mapping[str, CueFigures]
    guided: GuidedFigures | None = None
    tilt: TiltAgreement | None = None


@dataclass(frozen=True, kw_only=True)
class PartFigures:
    """What mapping says of one part of a series."""

    rounds: tuple[FilteringRound, ...]
    reliability: Reliability
    diagnostics: Diagnostics
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class ModelEntry:
    """One COLMAP model below sparse/."""

    model: str
    part: int
    kind: Literal["model", "twin"]
    num_images: int
    images: tuple[str, ...]
    num_points: int
    focal_length_px: float
    max_deviation_px: float


@dataclass(frozen=True, kw_only=True)
class OrientationTrial:
    """Places matched in the near and the far pairs of the trial, turned and upright."""

    near: tuple[int, int]
    far: tuple[int, int]


@dataclass(frozen=True, kw_only=True)
class StageRecord:
    """What every stage says: sentences for the report."""

    notes: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class IngestRecord(StageRecord):
    """Images prepared."""

    num_images: int
    pixel_size_um: float | None = None
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class ExtractRecord(StageRecord):
    """Keypoints found."""

    num_keypoints: Mapping[str, int]
    """of each image, those measured"""
    upright: bool = False
    orientation_trial: OrientationTrial | None = None


@dataclass(frozen=True, kw_only=True)
class MatchRecord(StageRecord):
    """Pairs matched and verified."""

    num_pairs: int
    num_verified_pairs: int
    pairs: tuple[PairStatistics, ...] = ()


@dataclass(frozen=True, kw_only=True)
class MapRecord(StageRecord):
    """Models written; the figures are those of the first part."""

    num_images: int
    num_points: int
    num_observations: int
    rms_px: float
    tracks: TrackCounts
    models: tuple[ModelEntry, ...]
    rounds: tuple[FilteringRound, ...]
    reliability: Reliability
    diagnostics: Diagnostics


@dataclass(frozen=True, kw_only=True)
class SurfaceHalves:
    """The surfaces of the odd and of the even frames, and how far apart they are."""

    num_points: tuple[int, int]
    shared: float
    """part of the odd frames' points where the even ones have a surface too"""
    rms_px: float
    """root mean square of the difference along the normals"""
    robust_rms_px: float
    """1.4826 times its median absolute value"""
    median_px: float
    """a shift of the one against the other"""
    expected_px: float
    """median of what the two error bars say of the difference"""
    ratio: float
    """robust deviation of difference over error bar; what the halves err in alike keeps it low"""


@dataclass(frozen=True, kw_only=True)
class DensifyRecord(StageRecord):
    """Depth maps and the fused cloud."""

    num_depth_maps: int
    num_points: int
    coverage: float | None = None
    """share of the sparse points that the cloud covers"""
    half_series: SurfaceHalves | None = None
    """where it was asked for"""


@dataclass(frozen=True, kw_only=True)
class MeshRecord(StageRecord):
    """The mesh."""

    num_vertices: int
    num_faces: int
    extent: tuple[float, ...] = field(default=())
    """world units, along the axes"""
    method: str | None = None
    num_components: int | None = None
    num_boundary_edges: int | None = None
    """of holes and rims; 0: a closed surface"""
    num_crossing_faces: int | None = None
    """of a closed surface: faces that pass through others where holes were closed"""
    area: float | None = None
    """world units squared"""
    volume: float | None = None
    """of a closed surface"""
    hull_area: float | None = None
    """of the convex hull of the vertices"""
    hull_volume: float | None = None
    """bounds the specimen's from above"""


@dataclass(frozen=True, kw_only=True)
class ForeignMeshRecord:
    """A mesh of a folder that another program filled."""

    model_path: str
    source: str
    """fused.ply, depth maps or sparse points"""
    sigma: str
    """what the error bars of the vertices hold, or why there are none"""
    num_points: int
    mesh: MeshRecord
    world_unit: str = ""
    """um where the model says so; empty: nothing is known of it"""


@dataclass(frozen=True, kw_only=True)
class ReportRecord(StageRecord):
    """The report."""

    num_metrics: int


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A number with its standard deviation."""

    value: float
    sigma: float


@dataclass(frozen=True, kw_only=True)
class ReadoutFigures:
    """Angles against what an actuator or a stage read, see docs/goniometer.md."""

    hysteresis_deg: Estimate | None
    """angle where the read-out rises minus where it falls; None where it runs one way only"""
    scatter_deg: float
    """robust standard deviation of an angle about the line: the repeatability of the read-out"""
    bend_deg: Estimate
    """departure from a straight line at the ends of the range, by a parabola"""
    is_straight: bool
    outliers: tuple[str, ...]
    """images whose read-out does not fit the others"""
    num_images: int


@dataclass(frozen=True, kw_only=True)
class StepFigures:
    """Evenness of the steps from image to image."""

    median_deg: float
    scatter_deg: float
    """robust standard deviation about the median"""
    largest_departure_deg: float
    """from the median, signed"""
    largest_departure_image: str
    """that the step leads to"""


@dataclass(frozen=True, kw_only=True)
class TurnFigures:
    """The step that closes a full turn."""

    closing_step_deg: float
    """from the last image on to the first"""
    minus_median_step_deg: float


@dataclass(frozen=True, kw_only=True)
class EccentricityFigures:
    """The specimen's centre beside the axis, and the drift that goes with the turn."""

    radius_px: Estimate
    radius_um: Estimate | None
    drift_px_per_turn: tuple[float, float]
    rest_px_rms: tuple[float, float]
    """what circle and drift leave: the path of the rotation axis in x and y"""


@dataclass(frozen=True, kw_only=True)
class GoniometerImage:
    """One image; None where something is not known."""

    angle_deg: float
    """about the axis, from the first image"""
    sigma_deg: float | None
    """against the mean of all angles"""
    displacement_um: float | None
    residual_deg: float | None
    """seen angle minus the line"""
    shift_px: tuple[float, float]
    """of the specimen's centre from its mean place"""
    shift_um: tuple[float, float] | None
    axis_offset_deg: tuple[float, float]
    """the axis in this image against the common one: within the image plane, and out of it"""
    axis_sigma_deg: tuple[float, float] | None
    """of these two"""
    move: tuple[float, float, float] | None
    """of the stage in x, y, z from the first image, in `move_unit`: keeps the next run centred"""


@dataclass(frozen=True, kw_only=True)
class GoniometerRecord:
    """The motion as a rotation by an actuator: report/goniometer.json."""

    model: str
    """digest of the model that it was measured on"""
    in_order: bool
    """False where the images were not in the order of the rotation"""
    conversion_deg_per_um: Estimate | None
    """None without displacements"""
    displacement_source: str | None
    displacement: ReadoutFigures | None
    tilt_ratio: Estimate | None
    """angle over the tilt that the stage recorded; None where none is recorded"""
    tilt: ReadoutFigures | None
    axis_camera: tuple[float, ...]
    axis_camera_sigma_deg: float
    """in the direction in which it is known worst"""
    axis_camera_sigmas_deg: tuple[float, float]
    """within the image plane, and out of it"""
    axis_world: tuple[float, ...]
    axis_world_sigma_deg: float
    axis_in_image_deg: float
    """from x toward y"""
    axis_out_of_image_deg: float
    """away from the viewer"""
    range_deg: float
    wobble_deg_rms: float
    steps: StepFigures
    turn: TurnFigures | None
    """None unless the images go round"""
    eccentricity: EccentricityFigures | None
    """None where the rotation is too small to tell a circle from a drift"""
    move_unit: Literal["um", "px"]
    images: Mapping[str, GoniometerImage]
    """in the order of acquisition, or of rotation where they were not in order"""
    order: tuple[str, ...]
    """names by angle"""
    notes: tuple[str, ...] = ()

    @property
    def hysteresis_deg(self) -> Estimate | None:
        """Of the actuator."""
        return None if self.displacement is None else self.displacement.hysteresis_deg


def to_plain(record: Any) -> dict[str, Any]:
    """A record as dicts, lists, numbers and strings, ready for JSON."""
    return asdict(record)


def known_only(record: Any) -> dict[str, Any]:
    """`to_plain` without the fields that are None."""
    return {key: value for key, value in to_plain(record).items() if value is not None}


def from_plain(kind: type[R], data: Mapping[str, Any]) -> R | None:
    """The record that `to_plain` was made of; None where the data are not one."""
    from pydantic import TypeAdapter, ValidationError

    try:
        return TypeAdapter(kind).validate_python(dict(data))
    except ValidationError:
        return None
