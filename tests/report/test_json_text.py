import numpy as np

from semsfm_colmap.report.json_text import plain, to_json


def test_json_knows_no_nan_and_no_arrays():
    value = {"a": np.array([1.0, np.nan]), "b": (np.int64(3), np.inf), "c": np.float64(2.5)}
    assert plain(value) == {"a": [1.0, None], "b": [3, None], "c": 2.5}


def test_each_row_of_numbers_takes_one_line():
    text = to_json({"matrix": [[1, 2], [3, 4]], "rows": [{"a": 1}, {"a": [2, 3]}], "empty": {}})
    assert "[1, 2],\n" in text
    assert '{"a": [2, 3]}' in text
