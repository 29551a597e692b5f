"""Small reduced systems laid out in a band, as only large ones are."""

from semsfm_colmap.geometry import reduced


def solve_in_bands(monkeypatch):
    monkeypatch.setattr(reduced, "DENSE_LIMIT", 0)
    monkeypatch.setattr(reduced, "MAX_BAND_SHARE", 1.0)
    monkeypatch.setattr(reduced, "MIN_BLOCK", 1)
