import io

import numpy as np
from PIL import Image

from semsfm_colmap.report.feature_study import FeatureStudy, study_body


def png():
    buffer = io.BytesIO()
    Image.fromarray(np.full((20, 40), 200, dtype=np.uint8)).save(buffer, "PNG")
    return buffer.getvalue()


def test_without_a_study_the_page_says_how_to_get_one():
    assert "semsfm compare-features IMAGES" in study_body(None)


def test_a_study_shows_its_figures_and_the_table_of_overlaps():
    study = FeatureStudy(
        overlap=(
            ("percent", "harris", "<b>"),
            ("harris", "100.0", "12.5"),
            ("<b>", "9.1", "100.0"),
        ),
        figures={"figure12": png(), "figure13": png()},
    )
    body = study_body(study)
    assert body.count("data:image/webp;base64,") == 2
    assert "the paper&#x27;s figure 12" in body
    assert "figure 3." not in body
    assert '<th scope="row" class="text">&lt;b&gt;</th><td>9.1</td>' in body
    assert "12.5" in body
