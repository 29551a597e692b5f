import numpy as np
import pytest

from semsfm_colmap.errors import UsageError
from tests.report.series import make_inputs, make_reconstruction


def test_a_model_that_repeats_a_name_is_refused():
    with pytest.raises(UsageError, match="repeats a name"):
        make_inputs(make_reconstruction(np.arange(2) * 4.0, image_names=("a.png", "a.png")))
