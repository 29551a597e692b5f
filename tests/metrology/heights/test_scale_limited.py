import numpy as np
import pytest

from semsfm_colmap.errors import InputError
from semsfm_colmap.metrology.heights.filters import gaussian
from semsfm_colmap.metrology.heights.scale_limited import (
    TRANSFER_PX,
    Filtering,
    Transfer,
    check_filtering,
    scale_limited,
)
from tests.metrology.heights.surfaces import a_map, rough

INNER = (slice(40, -40), slice(40, -40))


def test_what_the_reconstruction_has_filtered_off_is_not_filtered_off_again():
    z = rough(200, 200, 4.0, 1.0, seed=1)
    blurred = a_map(gaussian(z, (1.0, 1.0), 17.0))
    filtering = Filtering(s_index=34.0, form="none")
    known = scale_limited(a_map(z), filtering).z
    found = scale_limited(blurred, filtering, Transfer(nesting_index=17.0)).z
    twice = scale_limited(blurred, filtering).z
    assert np.isnan(known[0, 0])
    assert np.isnan(known[:, 0]).all()
    assert np.std((found - known)[INNER]) < 0.01 * np.nanstd(known)
    assert np.std((twice - known)[INNER]) > 0.1 * np.nanstd(known)


def test_the_l_filter_takes_the_large_scale_and_the_form_the_tilt():
    y, x = np.mgrid[0:200, 0:300].astype(float)
    small, large = np.cos(2 * np.pi * x / 30.0), 5.0 * np.cos(2 * np.pi * x / 290.0)
    found = scale_limited(
        a_map(small + large + 0.1 * y), Filtering(s_index=5.0, l_index=90.0, form="plane")
    ).z
    assert np.nanstd(found[:, 60:-60]) == pytest.approx(np.std(small), rel=0.06)


def test_relief_that_the_surface_does_not_hold_cannot_be_asked_for():
    height_map = a_map(np.zeros((60, 60)))
    transfer = Transfer.of_depth_maps(1.0)
    with pytest.raises(InputError, match=r"averaged away.*--s_filter 21\.96"):
        check_filtering(Filtering(s_index=18.0), transfer, height_map)
    check_filtering(Filtering(s_index=transfer.default_s_index), transfer, height_map)


def test_an_l_filter_below_the_s_filter_or_beyond_the_map_is_refused():
    height_map, transfer = a_map(np.zeros((60, 60))), Transfer(nesting_index=5.0)
    with pytest.raises(InputError, match="nothing would be left"):
        check_filtering(Filtering(s_index=20.0, l_index=10.0), transfer, height_map)
    with pytest.raises(InputError, match="larger than the map"):
        check_filtering(Filtering(s_index=20.0, l_index=70.0), transfer, height_map)


def test_the_transfer_grows_with_the_depth_maps_px_and_their_windows():
    assert Transfer.of_depth_maps(0.5).nesting_index == pytest.approx(TRANSFER_PX / 2)
    assert Transfer.of_depth_maps(1.0, window_px=14).nesting_index == pytest.approx(2 * TRANSFER_PX)
