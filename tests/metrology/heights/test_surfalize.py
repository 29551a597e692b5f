"""Against surfalize, which is GPL and no dependency: where it is installed beside."""

import warnings

import pytest

from semsfm_colmap.metrology.heights.areal import areal_parameters, material_ratios
from tests.metrology.heights.surfaces import a_map, rough

surfalize = pytest.importorskip("surfalize")

TOLERANCE = {
    **dict.fromkeys(("Sq", "Sa", "Sz", "Sp", "Sv", "Ssk", "Sku"), 1e-9),
    **dict.fromkeys(("Sk", "Smr2", "Vvv"), 1e-5),
    "Smr1": 1e-4,
    **dict.fromkeys(("Spk", "Svk", "Vmp", "Vmc", "Vvc"), 2e-3),
    **dict.fromkeys(("Sdq", "Sal", "Str"), 5e-3),
    "Sdr": 1e-2,
}
"""Named in docs/metrology_areal.md where it is above 1e-6."""


@pytest.mark.slow
def test_parameters_are_those_of_surfalize_where_the_definitions_agree():
    z = rough(300, 360, 12.0, 1.2, seed=1)
    z = z - z.mean()
    found = areal_parameters(a_map(z))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        surface = surfalize.Surface(z.copy(), 1.0, 1.0)
        other = {name: float(getattr(surface, name)()) for name in TOLERANCE}
        ratio = float(surface.Smr(0.5))
    for name, tolerance in TOLERANCE.items():
        assert found[name] == pytest.approx(other[name], rel=tolerance), name
    assert material_ratios(a_map(z), [0.5])[0] == pytest.approx(ratio, rel=1e-4)
