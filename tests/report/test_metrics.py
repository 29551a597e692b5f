from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.report.metrics import compute_metrics
from tests.report.series import empty_reconstruction, make_inputs, make_reconstruction, written


def test_missing_images_are_counted_and_named():
    rec = make_reconstruction(np.arange(3) * 4.0)
    a, b, c = rec.image_names
    images = compute_metrics(make_inputs(rec, names=[a, "lost 1.png", b, c, "lost 2.png"])).images
    assert (images.num_given, images.num_registered) == (5, 3)
    assert images.missing == ("lost 1.png", "lost 2.png")


def test_the_notes_are_those_of_the_run_and_the_series():
    inputs = make_inputs(make_reconstruction(np.arange(3) * 4.0), notes=("First.",))
    series = replace(inputs.series, warnings=("No pixel size.", "a.tif, b.tif: databar cut."))
    notes = compute_metrics(replace(inputs, series=series)).notes
    assert notes == ("First.", "No pixel size.", "a.tif, b.tif: databar cut.")


def test_the_pinhole_is_that_of_the_first_model_and_the_twin_is_known():
    inputs = make_inputs(make_reconstruction(np.arange(3) * 4.0))
    none = compute_metrics(inputs)
    assert none.telecentric is None
    assert not none.twin_written
    both = compute_metrics(replace(inputs, models=(written(), written("twin"))))
    assert both.telecentric == written()
    assert both.twin_written


@pytest.mark.parametrize("num_images", [0, 1, 2])
def test_images_without_points_have_metrics(num_images):
    m = compute_metrics(make_inputs(empty_reconstruction(num_images), names=["a", "b", "c"]))
    assert m.structure.num_points == 0
    assert m.structure.mean_track_length is None
    assert m.residuals is None
    assert m.mesh is None
