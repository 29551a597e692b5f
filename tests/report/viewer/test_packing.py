import numpy as np
import pytest

from semsfm_colmap.errors import InputError
from semsfm_colmap.report.viewer.packing import ALIGNMENT, TYPES, as_text, from_text, pack, unpack

HEADER = {"title": "</script> 花粉", "radius": 1.5, "none": None}


def arrays():
    rng = np.random.default_rng(0)
    some = {kind: (100 * rng.random((3, 5))).astype(kind) for kind in TYPES}
    return {**some, "empty": np.zeros((0, 3), dtype=np.float32)}


def test_header_and_arrays_come_back_as_they_were():
    header, found = unpack(pack(HEADER, arrays()))
    assert header == HEADER
    for name, values in arrays().items():
        np.testing.assert_array_equal(found[name], values)
        assert found[name].dtype == values.dtype


def test_every_array_begins_where_typed_arrays_may():
    data = pack(HEADER, arrays())
    body = len(data) - sum(-(-v.nbytes // ALIGNMENT) * ALIGNMENT for v in arrays().values())
    assert body % ALIGNMENT == 0
    for values in arrays().values():
        assert values.nbytes == 0 or data.find(values.tobytes(), body) % ALIGNMENT == 0


def test_text_gives_the_bytes_back_is_the_same_each_time_and_holds_no_markup():
    data = pack(HEADER, arrays())
    assert from_text(as_text(data)) == data
    assert as_text(data) == as_text(data)
    assert "<" not in as_text(data)


def test_types_that_the_script_does_not_read_are_refused():
    with pytest.raises(ValueError, match="float64"):
        pack({}, {"x": np.zeros(3)})


@pytest.mark.parametrize("cut", [4, 20, -1])
def test_bytes_that_are_cut_short_are_refused(cut):
    data = pack({}, {"x": np.arange(9, dtype=np.float32), "y": np.arange(2, dtype=np.float32)})
    with pytest.raises(InputError, match="cut short"):
        unpack(data[:cut])
