"""The summary and the tables of the page, from the metrics."""

from __future__ import annotations

from collections.abc import Iterator

from semsfm_colmap.report.html_parts import Row, definitions, hint, table
from semsfm_colmap.report.image_statistics import PoseMetrics
from semsfm_colmap.report.metrics import Metrics
from semsfm_colmap.report.number_text import confidence, fixed, number, percent, unit_text


def _with_nm(px: float | None, nm: float | None) -> str:
    return f"{number(px)} px" + ("" if nm is None else f" = {number(nm)} nm")


def _image_rows(m: Metrics) -> Iterator[tuple[str, str]]:
    images, world, s = m.images, m.world, m.structure
    yield "images registered", f"{number(images.num_registered)} of {number(images.num_given)}"
    yield "world unit", unit_text(world.unit)
    if world.pixel_size_nm is not None:
        yield "pixel size", f"{number(world.pixel_size_nm, 4)} nm"
        yield "pixel size from", world.pixel_size_source
    yield "camera model", world.camera_model.replace("_", " ")
    if world.aspect != 1.0 or world.skew != 0.0:
        yield "aspect, skew", f"{number(world.aspect, 5)}, {number(world.skew, 2)}"
    yield "points", number(s.num_points)
    yield "points in 3 or more images", number(s.num_points_in_3_or_more_images)
    yield "observations kept", number(s.num_observations)
    # a COLMAP model holds what was kept only: what was rejected is told by the rounds of filtering
    if s.num_rejected_observations:
        rejected = percent(s.rejected_fraction)
        yield "observations rejected", f"{number(s.num_rejected_observations)} ({rejected})"
    mean, median = number(s.mean_track_length), number(s.median_track_length)
    yield "images per point", f"{mean} mean, {median} median"
    if s.sigma is not None:
        sigma = number(s.sigma.median_point_sigma_world)
        yield "σ of a point (median)", f"{sigma} {unit_text(world.unit)}"


def _residual_rows(m: Metrics) -> Iterator[tuple[str, str]]:
    r = m.residuals
    if r is None:
        return
    yield "residual σ in x", _with_nm(r.x.sigma_px, r.x.sigma_nm)
    yield "residual σ in y", _with_nm(r.y.sigma_px, r.y.sigma_nm)
    yield "RMS per coordinate", _with_nm(r.rms_per_coordinate_px, r.rms_per_coordinate_nm)
    yield "noise of a coordinate", _with_nm(r.noise_sigma_px, r.noise_sigma_nm)


def _motion_rows(m: Metrics) -> Iterator[tuple[str, str]]:
    rotation, sign = m.rotation, m.depth_sign
    if rotation is not None:
        yield "rotation range", f"{number(rotation.range_deg, 4)}°"
        low, high = number(rotation.min_step_deg), number(rotation.max_step_deg)
        yield "steps", f"{number(rotation.median_step_deg)}° median, {low}° to {high}°"
        axis = ", ".join(fixed(c, 3) for c in rotation.axis_camera)
        yield "rotation axis in the camera", f"({axis})"
        rms, most = fixed(rotation.wobble_rms_deg, 2), fixed(rotation.wobble_max_deg, 2)
        yield "wobble", f"{rms}° rms, {most}° at most"
    yield "depth sign", f"{sign.status}, {confidence(sign.confidence)}"


def _surface_rows(m: Metrics) -> Iterator[tuple[str, str]]:
    if m.cloud is not None:
        yield "points of the dense cloud", number(m.cloud.num_points)
        if m.cloud.median_sigma_world is not None:
            middle, most = number(m.cloud.median_sigma_world), number(m.cloud.p95_sigma_world)
            unit = unit_text(m.world.unit)
            yield "σ along its normals", f"{middle} {unit} median, 95 % below {most} {unit}"
        halves = m.cloud.half_series
        if halves is not None:
            apart, said = number(halves.robust_rms_px), number(halves.expected_px)
            yield (
                "surfaces of odd and even frames",
                f"{apart} px apart, {number(halves.ratio)} of what their σ say ({said} px)",
            )
    mesh = m.mesh
    if mesh is not None:
        yield "mesh", f"{number(mesh.num_faces)} faces, {number(mesh.num_vertices)} vertices"
        pieces, edges = number(mesh.num_components), number(mesh.num_open_edges)
        yield "mesh components, open edges", f"{pieces}, {edges}"
        yield "mesh area", f"{number(mesh.area_world2)} {unit_text(m.world.unit)}²"
    if m.telecentric is not None:
        yield "COLMAP focal length", f"{number(m.telecentric.focal_length_px)} px"
        deviation = number(m.telecentric.max_deviation_px, 2)
        yield "its departure from parallel rays", f"{deviation} px at most"


def summary(m: Metrics) -> str:
    """The key numbers."""
    return definitions([*_image_rows(m), *_residual_rows(m), *_motion_rows(m), *_surface_rows(m)])


IMAGE_HEADERS = (
    "frame", "image", "points", "rejected", "RMS px", "angle °", "σ °", "step °", "wobble °",
    "scale %", "found to next", "verified to next", "verified in all",
)  # fmt: skip
NUM_POSE_CELLS = 8
"""From the points to the scale: empty for an image that could not be registered."""


def images_table(m: Metrics) -> str:
    """One row an image, in acquisition order."""
    rows = []
    for image in m.per_image:
        matches = (
            number(image.matches.num_matches_to_next),
            number(image.matches.num_verified_matches_to_next),
            number(image.matches.num_verified_matches),
        )
        name = image.name if image.pose is not None else f"{image.name} (not registered)"
        cells = (str(image.frame), name, *_pose_cells(image.pose), *matches)
        rows.append(Row(cells=cells, absent=image.pose is None))
    return table(IMAGE_HEADERS, rows, text_columns=(1,), label="All images")


def _pose_cells(pose: PoseMetrics | None) -> tuple[str, ...]:
    """The middle columns of the table of images; dashes without a pose."""
    if pose is None:
        return (number(None),) * NUM_POSE_CELLS
    return (
        number(pose.num_observations), number(pose.num_rejected_observations), number(pose.rms_px),
        fixed(pose.angle_deg, 2), fixed(pose.sigma_angle_deg, 3), fixed(pose.step_deg, 2),
        fixed(pose.wobble_deg, 3), fixed(100.0 * (pose.relative_scale - 1.0), 3),
    )  # fmt: skip


def pairs_table(m: Metrics, max_rows: int) -> str:
    """What the filters dropped overall, and the pairs that were rejected as a whole."""
    matches = m.matches
    if matches.num_pairs_tried == 0:
        return hint("No matching statistics were given.")
    lost = matches.rejected_fraction
    body = definitions(
        [
            ("pairs tried", number(matches.num_pairs_tried)),
            ("pairs verified", number(matches.num_pairs_verified)),
            ("matches found", number(matches.num_matches)),
            ("matches verified", number(matches.num_verified_matches)),
            ("dropped as static background", percent(lost.static_background)),
            ("dropped by affine RANSAC", percent(lost.affine_ransac)),
            ("dropped by the distance filter", percent(lost.distance_filter)),
            ("dropped with rejected pairs", percent(lost.rejected_pairs)),
        ]
    )
    rejected = matches.rejected
    if not rejected:
        return body + hint("No pair was rejected as a whole.")
    rows = [
        Row(
            cells=(
                p.image_name_1, p.image_name_2, number(p.num_matches),
                number(p.num_static_rejected), number(p.num_after_affine_ransac),
                number(p.num_after_distance_filter), p.failure or "",
            )
        )
        for p in rejected[:max_rows]
    ]  # fmt: skip
    headers = (
        "image", "image", "matches", "static", "after RANSAC", "after distance filter",
        "rejected because",
    )  # fmt: skip
    title = "Pairs rejected as a whole"
    body += f"<h3>{title}</h3>" + table(headers, rows, text_columns=(0, 1, 6), label=title)
    if len(rejected) > max_rows:
        body += hint(f"{len(rejected) - max_rows} more rejected pairs are listed in metrics.json.")
    return body


def rounds_table(m: Metrics) -> str:
    """The graduated filtering of observations by reprojection error."""
    rows = [
        Row(
            cells=(
                str(k), number(r.record.threshold_px), number(r.num_kept), number(r.num_dropped),
                percent(r.dropped_fraction),
            )
        )
        for k, r in enumerate(m.filtering_rounds, start=1)
    ]  # fmt: skip
    if not rows:
        return hint("No filtering rounds were given.")
    headers = ("round", "threshold px", "observations kept", "dropped", "share")
    return table(headers, rows, text_columns=(), narrow=True, label="Rounds of filtering")


def guided_table(m: Metrics) -> str:
    """Tracks before and after the guided second pass."""
    g = m.guided
    if g is None:
        return hint("There was no guided second pass; the model rests on the matched keypoints.")
    compared = (
        ("observations", g.num_observations_before, g.num_observations),
        ("mean track length", g.mean_track_length_before, g.mean_track_length),
        ("noise of a coordinate, px", g.sigma_before_px, g.sigma_px),
    )
    rows = [Row(cells=(label, number(before), number(after))) for label, before, after in compared]
    text = (
        "<p>Every point was looked for in every image that should see it: "
        f"{number(g.num_found)} of {number(g.num_places)} places were found, by structure "
        f"finer than {g.high_pass_px:g} px, in pass {g.num_passes}. Drift within the frames "
        f"was taken out: up to {g.largest_drift_px:.2f} px from the first row to the last.</p>"
    )
    headers = ("of the tracks", "matched", "guided")
    return text + table(headers, rows, text_columns=(0,), narrow=True, label="Guided pass")


def run_tables(m: Metrics) -> str:
    """Stage times, peak memory and versions."""
    stages = [Row(cells=(s.name, number(s.seconds), number(s.peak_memory_mb))) for s in m.stages]
    body = ""
    if stages:
        headers = ("stage", "seconds", "peak memory MB")
        body += table(headers, stages, text_columns=(0,), narrow=True, label="Stages")
    if m.versions:
        rows = [Row(cells=(name, version)) for name, version in m.versions.items()]
        body += "<h3>Versions</h3>" + table(
            ("package", "version"), rows, text_columns=(0, 1), narrow=True, label="Versions"
        )
    return body or hint("No run record was given.")
