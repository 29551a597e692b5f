import numpy as np
import pytest

from semsfm_colmap.colmap.database.two_view import stored_geometry
from semsfm_colmap.types import AffineTwoViewGeometry


@pytest.mark.parametrize("ids", [(3, 1, 7), (7, 1, 3)])
def test_a_pair_is_stored_with_the_smaller_id_first(ids):
    F = np.arange(9.0).reshape(3, 3)
    rows = np.column_stack([np.arange(10), np.arange(10) + 5])
    geometry = AffineTwoViewGeometry(
        image_pair=(0, 2),
        keypoints=rows,
        F=F,
        inlier=np.arange(10) < 5,
        residual_px=np.zeros(10),
    )
    pair, (stored, matches) = stored_geometry(geometry, ids)
    assert pair == (3, 7)
    swapped = ids[0] > ids[2]
    np.testing.assert_array_equal(stored, F.T if swapped else F)
    np.testing.assert_array_equal(matches, rows[:5, ::-1] if swapped else rows[:5])
