from __future__ import annotations

from semsfm_colmap.errors import InputError, SemSfmError, UsageError
from semsfm_colmap.ingest.files.header import UnreadableImageError


def test_the_exit_codes_are_those_of_the_design() -> None:
    assert InputError("x").exit_code == 1
    assert UsageError("x").exit_code == 2
    assert issubclass(UnreadableImageError, SemSfmError)
