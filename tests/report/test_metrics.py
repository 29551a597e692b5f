import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.errors import UsageError
from semsfm_colmap.records import PairStatistics
from semsfm_colmap.report.inputs import ReportInputs
from semsfm_colmap.report.json_text import plain, to_json
from semsfm_colmap.report.metrics import compute_metrics
from semsfm_colmap.types import OrthographicCameras, PointCloud, SemMetadata, SemSeries
from tests.report.series import (
    SCALE,
    chain_of_pairs,
    cube,
    empty_reconstruction,
    make_inputs,
    make_reconstruction,
)

DOCS = Path(__file__).parents[2] / "docs" / "report.md"


def test_the_noise_put_in_comes_out_per_axis_from_both_sides():
    rec = make_reconstruction(np.arange(20) * 4.0, num_points=3000, sigma_px=(0.3, 0.5))
    r = compute_metrics(make_inputs(rec))["residuals"]
    bound = 5.0 / np.sqrt(2.0 * r["num_residuals"])
    for letter, sigma in (("x", 0.3), ("y", 0.5)):
        assert abs(r[f"sigma_{letter}_px"] / sigma - 1.0) < bound
        assert abs(r[f"mean_{letter}_px"]) < 5.0 * sigma / np.sqrt(r["num_residuals"])
        # the median absolute deviation has 37 % efficiency
        assert abs(r[f"robust_sigma_{letter}_px"] / sigma - 1.0) < bound / np.sqrt(0.37)
    rms = np.sqrt((0.3**2 + 0.5**2) / 2.0)
    assert r["rms_per_coordinate_px"] == pytest.approx(rms, rel=bound)


def fitted_points(rec):
    """The points that fit the measurements best: linear least squares, point by point."""
    obs, P = rec.observations, rec.cameras.projection
    points = np.empty_like(rec.points)
    for j in range(len(points)):
        rows = np.flatnonzero(obs.track_idx == j)
        A = P[obs.image_idx[rows]].reshape(-1, 3)
        b = (obs.xy[rows] - rec.cameras.translation_px[obs.image_idx[rows]]).reshape(-1)
        points[j] = np.linalg.lstsq(A, b, rcond=None)[0]
    return replace(rec, points=points)


def test_the_noise_estimate_undoes_what_fitting_the_points_takes_up():
    rec = fitted_points(
        make_reconstruction(np.arange(12) * 6.0, num_points=1500, sigma_px=(0.4, 0.4), window=2)
    )
    r = compute_metrics(make_inputs(rec))["residuals"]
    assert r["sigma_x_px"] < 0.35
    assert r["noise_sigma_px"] == pytest.approx(0.4, rel=0.03)


def test_nanometres_are_pixels_times_the_pixel_size():
    rec = make_reconstruction(np.arange(5) * 4.0)
    m = compute_metrics(make_inputs(rec))
    r = m["residuals"]
    assert m["world"]["pixel_size_nm"] == pytest.approx(50.0)
    assert r["sigma_x_nm"] == pytest.approx(50.0 * r["sigma_x_px"])
    assert r["noise_sigma_nm"] == pytest.approx(50.0 * r["noise_sigma_px"])


def test_a_stretched_y_axis_has_smaller_pixels_there():
    rec = make_reconstruction(np.arange(5) * 4.0)
    cameras = rec.cameras
    stretched = OrthographicCameras(
        cam_from_world=cameras.cam_from_world,
        scale_px_per_unit=cameras.scale_px_per_unit,
        translation_px=cameras.translation_px,
        aspect=1.25,
    )
    r = compute_metrics(make_inputs(replace(rec, cameras=stretched)))["residuals"]
    assert r["sigma_y_nm"] == pytest.approx(40.0 * r["sigma_y_px"])


def test_without_a_pixel_size_there_are_no_nanometres():
    rec = make_reconstruction(
        np.arange(5) * 4.0, world_unit="px", pixel_size_um=None, pixel_size_source="none"
    )
    m = compute_metrics(make_inputs(rec))
    assert m["world"]["pixel_size_nm"] is None
    assert m["residuals"]["sigma_x_nm"] is None
    assert m["residuals"]["noise_sigma_nm"] is None


def test_a_model_in_micrometres_without_a_stated_pixel_size_has_it_from_its_scale():
    rec = make_reconstruction(np.arange(5) * 4.0, pixel_size_um=None)
    assert compute_metrics(make_inputs(rec))["world"]["pixel_size_nm"] == pytest.approx(
        1000.0 / SCALE
    )


def test_steps_and_range_of_a_known_series_are_recovered():
    angles = np.cumsum([0.0, 3.0, 5.0, 4.0, 6.0])
    m = compute_metrics(make_inputs(make_reconstruction(angles)))
    np.testing.assert_allclose([row["angle_deg"] for row in m["per_image"]], angles, atol=1e-9)
    assert m["per_image"][0]["step_deg"] is None
    np.testing.assert_allclose(
        [row["step_deg"] for row in m["per_image"]][1:], np.diff(angles), atol=1e-9
    )
    np.testing.assert_allclose(
        [row["rotation_from_first_deg"] for row in m["per_image"]], angles, atol=1e-6
    )
    assert m["rotation"]["range_deg"] == pytest.approx(18.0)
    assert m["rotation"]["closure"]["is_full_turn"] is False


def test_a_full_turn_with_an_angle_scale_error_shows_it_in_the_closing_step():
    error = 0.004
    angles = np.arange(72) * 5.0 * (1.0 + error)
    closure = compute_metrics(make_inputs(make_reconstruction(angles)))["rotation"]["closure"]
    assert closure["is_full_turn"] is True
    assert closure["closing_minus_median_step_deg"] == pytest.approx(-360.0 * error, abs=1e-9)
    assert closure["last_to_first_rotation_deg"] == pytest.approx(closure["last_to_first_deg"])


def test_the_slope_against_the_stage_tilt_is_the_angle_scale():
    angles = np.arange(10) * 3.0
    inputs = make_inputs(make_reconstruction(1.004 * angles))
    frames = tuple(
        replace(frame, metadata=SemMetadata(tilt_rad=None if k == 4 else np.deg2rad(10.0 - tilt)))
        for k, (frame, tilt) in enumerate(zip(inputs.series.frames, angles, strict=True))
    )
    m = compute_metrics(replace(inputs, series=SemSeries(frames=frames)))
    tilt = m["rotation"]["stage_tilt"]
    assert tilt["slope"] == pytest.approx(1.004)
    assert tilt["rms_deg"] < 1e-9
    assert tilt["num_images"] == 9
    assert m["per_image"][4]["stage_tilt_deg"] is None
    assert m["per_image"][0]["stage_tilt_deg"] == pytest.approx(10.0)


def test_the_uncertainty_about_the_axis_combines_those_about_x_y_z():
    rec = make_reconstruction(np.arange(6) * 4.0)
    m = compute_metrics(
        make_inputs(replace(rec, sigma_rotation_rad=np.full((6, 3), np.deg2rad(0.02))))
    )
    assert m["per_image"][3]["sigma_angle_deg"] == pytest.approx(0.02)


def test_rows_follow_the_series_whatever_the_order_of_the_reconstruction():
    rec = make_reconstruction(np.arange(6) * 4.0)
    order = np.array([3, 0, 5, 1, 4, 2])
    place = np.argsort(order)
    mixed = replace(
        rec,
        image_names=tuple(rec.image_names[i] for i in order),
        cameras=rec.cameras.select(order),
        observations=replace(
            rec.observations, image_idx=place[rec.observations.image_idx].astype(np.int64)
        ),
    )
    plain_rows = compute_metrics(make_inputs(rec))
    mixed_rows = compute_metrics(make_inputs(mixed, names=rec.image_names))
    for a, b in zip(plain_rows["per_image"], mixed_rows["per_image"], strict=True):
        assert a["name"] == b["name"]
        assert a["num_observations"] == b["num_observations"]
        assert a["rms_px"] == pytest.approx(b["rms_px"])
        assert a["angle_deg"] == pytest.approx(b["angle_deg"], abs=1e-9)
    assert plain_rows["co_visibility"] == mixed_rows["co_visibility"]


def test_missing_images_are_named_and_keep_their_numbers():
    rec = make_reconstruction(np.arange(4) * 4.0)
    a, b, c, d = rec.image_names
    m = compute_metrics(make_inputs(rec, names=[a, "lost 1.png", b, c, d, "lost 2.png"]))
    assert m["images"] == {
        "num_given": 6,
        "num_registered": 4,
        "missing": ["lost 1.png", "lost 2.png"],
    }
    assert [row["registered"] for row in m["per_image"]] == [True, False, True, True, True, False]
    assert m["co_visibility"]["frames"] == [1, 3, 4, 5]
    assert "rms_px" not in m["per_image"][1]


def test_images_that_only_the_reconstruction_knows_come_last():
    rec = make_reconstruction(np.arange(3) * 4.0)
    m = compute_metrics(make_inputs(rec, names=[rec.image_names[2], "lost.png"]))
    assert [row["name"] for row in m["per_image"]] == [
        rec.image_names[2],
        "lost.png",
        rec.image_names[0],
        rec.image_names[1],
    ]


def test_rejected_observations_count_as_rejected_and_nowhere_else():
    rec = make_reconstruction(np.arange(6) * 4.0, num_points=100)
    inlier = np.ones(len(rec.inlier), dtype=np.bool_)
    inlier[::5] = False
    xy = np.array(rec.observations.xy)
    xy[~inlier] += 500.0
    rec = replace(rec, inlier=inlier, observations=replace(rec.observations, xy=xy))
    m = compute_metrics(make_inputs(rec))
    assert m["structure"]["num_observations"] == int(inlier.sum())
    assert m["structure"]["rejected_fraction"] == pytest.approx(float((~inlier).mean()))
    assert m["residuals"]["max_error_px"] < 5.0
    assert sum(row["num_rejected_observations"] for row in m["per_image"]) == int((~inlier).sum())


def test_track_lengths_are_counted():
    rec = make_reconstruction(np.arange(5) * 4.0, num_points=10, window=1)
    s = compute_metrics(make_inputs(rec))["structure"]
    # of ten points, two belong to either end of the series (2 images) and six do not (3 images)
    assert s["track_length_counts"] == [0, 0, 4, 6]
    assert s["mean_track_length"] == pytest.approx(2.6)
    assert s["median_track_length"] == 3.0
    assert s["num_points_in_3_or_more_images"] == 6


def test_co_visibility_agrees_with_counting_one_by_one():
    rec = make_reconstruction(np.arange(7) * 4.0, num_points=60, window=2)
    inlier = np.random.default_rng(1).random(len(rec.inlier)) > 0.3
    rec = replace(rec, inlier=inlier)
    seen = [
        set(rec.observations.track_idx[(rec.observations.image_idx == i) & inlier].tolist())
        for i in range(7)
    ]
    expected = [[len(a & b) for b in seen] for a in seen]
    assert compute_metrics(make_inputs(rec))["co_visibility"]["num_shared_tracks"] == expected


def test_matches_are_summed_per_frame_and_with_the_next():
    rec = make_reconstruction(np.arange(4) * 4.0)
    a, b, c, d = rec.image_names
    broken = PairStatistics(
        image_name_1=d,
        image_name_2=c,
        num_matches=40,
        num_after_affine_ransac=9,
        num_after_distance_filter=8,
        failure="too few agree",
    )
    pairs = (*chain_of_pairs([a, b, c]), broken)
    m = compute_metrics(make_inputs(rec, pairs=pairs))
    rows = m["per_image"]
    assert [row["num_matches"] for row in rows] == [100, 200, 140, 40]
    assert [row["num_verified_matches"] for row in rows] == [75, 150, 75, 0]
    assert [row["num_matches_to_next"] for row in rows] == [100, 100, 40, None]
    assert [row["num_verified_matches_to_next"] for row in rows] == [75, 75, 0, None]
    totals = m["matches"]
    assert totals["num_pairs_verified"] == 2
    assert totals["verified_fraction"] == pytest.approx(150 / 240)
    assert totals["rejected_fraction"] == pytest.approx(
        {
            "static_background": 20 / 240,
            "affine_ransac": (10 + 10 + 31) / 240,
            "distance_filter": (5 + 5 + 1) / 240,
            "rejected_pairs": 8 / 240,
        }
    )
    lost = 1.0 - totals["verified_fraction"]
    assert sum(totals["rejected_fraction"].values()) == pytest.approx(lost)
    assert [p["failure"] for p in totals["rejected"]] == ["too few agree"]


def test_a_pair_with_an_unknown_image_counts_for_the_known_one_only():
    rec = make_reconstruction(np.arange(3) * 4.0)
    pairs = chain_of_pairs([rec.image_names[0], "elsewhere.png"])
    rows = compute_metrics(make_inputs(rec, pairs=pairs))["per_image"]
    assert [row["num_matches"] for row in rows] == [100, 0, 0]


def test_filtering_rounds_carry_their_share():
    rec = make_reconstruction(np.arange(3) * 4.0)
    rounds = ({"threshold_px": 8.0, "num_kept": 90, "num_dropped": 10, "num_points": 7},)
    m = compute_metrics(make_inputs(rec, filtering_rounds=rounds))
    assert m["filtering_rounds"] == [{**rounds[0], "dropped_fraction": 0.1}]


def test_a_filtering_round_without_its_keys_is_refused():
    rec = make_reconstruction(np.arange(3) * 4.0)
    with pytest.raises(UsageError, match="num_dropped"):
        make_inputs(rec, filtering_rounds=({"threshold_px": 8.0, "num_kept": 90},))


def test_a_cube_has_its_area_box_and_no_open_edge():
    rec = make_reconstruction(np.arange(3) * 4.0)
    mesh = compute_metrics(make_inputs(rec, mesh=cube(side=3.0)))["mesh"]
    assert mesh["num_components"] == 1
    assert mesh["num_open_edges"] == 0
    assert mesh["area_world2"] == pytest.approx(54.0)
    assert mesh["bounding_box_size_world"] == [3.0, 3.0, 3.0]


def test_two_cubes_one_without_its_lid_are_two_components_with_four_open_edges():
    box = cube()
    vertices = np.concatenate([box.vertices, box.vertices + 5.0, [[99.0, 99.0, 99.0]]])
    faces = np.concatenate([box.faces, box.faces[2:] + 8])
    mesh = compute_metrics(
        make_inputs(
            make_reconstruction(np.arange(3) * 4.0),
            mesh=replace(box, vertices=vertices, faces=faces),
        )
    )["mesh"]
    assert mesh["num_components"] == 2
    assert mesh["num_open_edges"] == 4
    assert mesh["area_world2"] == pytest.approx(11.0)
    assert mesh["largest_component_area_fraction"] == pytest.approx(6.0 / 11.0)
    # the vertex that no face uses does not count
    assert mesh["bounding_box_size_world"] == [6.0, 6.0, 6.0]


def test_the_relative_scale_is_relative_to_the_median():
    rec = make_reconstruction(np.arange(3) * 4.0)
    cameras = replace(rec.cameras, scale_px_per_unit=np.array([19.98, 20.0, 20.01]))
    rows = compute_metrics(make_inputs(replace(rec, cameras=cameras)))["per_image"]
    assert [row["relative_scale"] for row in rows] == pytest.approx([0.999, 1.0, 1.0005])


def test_the_notes_are_those_of_the_run_and_the_series():
    inputs = make_inputs(make_reconstruction(np.arange(3) * 4.0), notes=("First.",))
    series = replace(inputs.series, warnings=("No pixel size.", "a.tif, b.tif: databar cut."))
    notes = compute_metrics(replace(inputs, series=series))["notes"]
    assert notes == ["First.", "No pixel size.", "a.tif, b.tif: databar cut."]


@pytest.mark.parametrize("num_images", [0, 1, 2])
def test_images_without_points_have_metrics(num_images):
    m = compute_metrics(make_inputs(empty_reconstruction(num_images), names=["a", "b", "c"]))
    assert m["structure"]["num_points"] == 0
    assert m["structure"]["mean_track_length"] is None
    assert m["residuals"] == {"num_residuals": 0}
    assert m["mesh"] is None


def full_inputs() -> ReportInputs:
    """Inputs in which nothing is missing."""
    rec = make_reconstruction(
        np.arange(6) * 4.0,
        sigma_rotation_rad=np.full((6, 3), 1e-4),
        sigma_translation_px=np.full((6, 2), 0.02),
        sigma_scale=np.full(6, 1e-4),
        point_covariance=np.tile(0.01 * np.eye(3), (400, 1, 1)),
    )
    pairs = chain_of_pairs([*rec.image_names])
    inputs = make_inputs(
        rec,
        names=[*rec.image_names, "lost.png"],
        pairs=(*pairs, replace(pairs[0], failure="no overlap")),
        stage_times={"match": 1.5},
        stage_peak_memory_mb={"match": 200.0},
        filtering_rounds=({"threshold_px": 8.0, "num_kept": 90, "num_dropped": 10},),
        mesh=cube(),
        cloud=PointCloud(points=np.zeros((3, 3))),
        versions={"numpy": "2.0"},
        telecentric={"focal_length_px": 1e6, "max_deviation_px": 0.01},
    )
    frames = tuple(
        replace(frame, metadata=SemMetadata(tilt_rad=0.1 * k))
        for k, frame in enumerate(inputs.series.frames)
    )
    return replace(inputs, series=SemSeries(frames=frames))


def test_the_point_sigma_is_the_expected_distance():
    m = compute_metrics(full_inputs())
    assert m["structure"]["median_point_sigma_world"] == pytest.approx(np.sqrt(0.03))


def test_the_text_is_json_and_says_the_same():
    m = compute_metrics(full_inputs())
    assert json.loads(to_json(m)) == m


def test_json_knows_no_nan_and_no_arrays():
    value = {"a": np.array([1.0, np.nan]), "b": (np.int64(3), np.inf), "c": np.float64(2.5)}
    assert plain(value) == {"a": [1.0, None], "b": [3, None], "c": 2.5}


def test_each_row_of_numbers_takes_one_line():
    text = to_json({"matrix": [[1, 2], [3, 4]], "rows": [{"a": 1}, {"a": [2, 3]}], "empty": {}})
    assert "[1, 2],\n" in text
    assert '{"a": [2, 3]}' in text


def keys_of(value, parents=()):
    if isinstance(value, dict):
        for key, item in value.items():
            if parents not in {("versions",), ("depth_sign", "evidence")}:
                yield key
                yield from keys_of(item, (*parents, key))
    elif isinstance(value, list):
        for item in value:
            yield from keys_of(item, parents)


def test_every_key_is_explained_in_the_documentation():
    text = DOCS.read_text(encoding="utf-8")
    missing = {key for key in keys_of(compute_metrics(full_inputs())) if f"`{key}`" not in text}
    assert not missing
