from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.report.options import ReportOptions
from semsfm_colmap.report.write import write_report
from tests.report.images.evidence import make_evidence, numbered
from tests.report.series import full_inputs, make_inputs, make_reconstruction, sphere


@pytest.fixture(scope="session")
def full_page(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Address of a report in which nothing is missing; its observations are exact."""
    folder = tmp_path_factory.mktemp("page")
    exact = make_reconstruction(np.arange(6) * 6.0, window=2, sigma_px=(0.0, 0.0))
    rec = numbered(exact)
    inputs = replace(
        full_inputs(),
        reconstruction=rec,
        series=make_inputs(rec, names=[*rec.image_names, "lost.png"]).series,
        evidence=make_evidence(rec),
        mesh=sphere(40),
        cloud=None,
    )
    write_report(inputs, folder, ReportOptions(figure_dpi=60))
    return (folder / "report.html").as_uri()
