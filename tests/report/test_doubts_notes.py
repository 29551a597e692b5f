"""What the stages warn of is a doubt, in their words and once."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import semsfm_colmap
from semsfm_colmap.ingest.series.remarks import frame_warnings, series_warnings
from semsfm_colmap.refinement.magnification import magnification_notes
from semsfm_colmap.report.doubts_notes import CAUSES_NOTED
from semsfm_colmap.types import SemMetadata
from tests.report.series import make_inputs, make_reconstruction
from tests.report.test_verdict import ANGLES, titles, verdict

PACKAGE = Path(semsfm_colmap.__file__).parent


def sentences():
    """The texts of all modules but the report's, with literals that go over lines joined."""
    texts = [p.read_text() for p in PACKAGE.rglob("*.py") if "report" not in p.parts]
    return re.sub(r'"\s*\n\s*f?"', "", "\n".join(texts))


@pytest.mark.parametrize("cause", CAUSES_NOTED, ids=lambda cause: cause.title)
def test_every_cause_is_a_sentence_of_some_stage(cause):
    assert cause.words in sentences()


@pytest.mark.parametrize("cause", CAUSES_NOTED, ids=lambda cause: cause.title)
def test_a_warning_is_a_doubt_in_its_words_and_listed_no_second_time(cause):
    note = f"a.tif: {cause.words} and so on."
    result = verdict(make_reconstruction(ANGLES), notes=(note,))
    assert titles(result) == [cause.title]
    assert cause.words in result.doubts[0].sentence
    assert result.not_said((note,)) == ()


def test_information_is_no_doubt():
    note = "features are those of database.db"
    result = verdict(make_reconstruction(ANGLES), notes=(note,))
    assert result.doubts == ()
    assert result.not_said((note,)) == (note,)


def test_tilt_correction_in_a_header_reaches_the_verdict():
    inputs = make_inputs(make_reconstruction(ANGLES))
    frames = [
        replace(frame, metadata=SemMetadata(tilt_corrected=k > 2))
        for k, frame in enumerate(inputs.series.frames)
    ]
    warnings = (*frame_warnings(frames), *series_warnings(frames))
    result = verdict(make_reconstruction(ANGLES), notes=warnings)
    assert titles(result) == ["the microscope has stretched images (tilt correction)"]


def test_a_doubt_from_numbers_stands_for_the_notes_that_say_the_same():
    rec = make_reconstruction(ANGLES)
    scale = np.linspace(0.9, 1.0, len(ANGLES))
    rec = replace(rec, cameras=replace(rec.cameras, scale_px_per_unit=20.0 * scale))
    sizes = np.stack([np.full(len(ANGLES), 320.0), np.linspace(240.0, 270.0, len(ANGLES))], axis=1)
    notes = tuple(magnification_notes(scale, sizes, estimated=True))
    result = verdict(rec, notes=notes)
    # the sizes have no number of their own: stretched frames bend angles
    assert "the images differ in size" in titles(result)
    assert sum("magnification" in title for title in titles(result)) == 1
    assert result.not_said(notes) == ()
