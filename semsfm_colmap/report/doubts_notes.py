"""Doubts that the stages have noted and no number of the report carries.

One rule: what a stage warns of as a cause of wrong angles, depths or lengths is a doubt of the
verdict, in the stage's own words. A doubt from numbers that says the same stands for its notes
(`Doubt.covers`); other notes are information and are listed as they are.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from semsfm_colmap.report.doubt import NO_ERROR, WHOLE, Doubt
from semsfm_colmap.report.metrics import Metrics


@dataclass(frozen=True, kw_only=True)
class Cause:
    """A kind of note: words that it holds, and what it means for the result."""

    words: str
    title: str
    action: str
    size: float


STRETCHED = 0.1
"""Relative error of angles of images that were stretched along one axis by several percent, or of a
background among the points."""
CAUSES_NOTED = (
    Cause(
        words="tilt correction was on",
        title="the microscope has stretched images (tilt correction)",
        action="record the series with tilt correction off",
        size=STRETCHED,
    ),
    Cause(
        words="dynamic focus was on",
        title="dynamic focus was on",
        action="record the series with dynamic focus off",
        size=0.01,
    ),
    Cause(
        words="the images differ in size",
        title="the images differ in size",
        action="give the images as the microscope wrote them, neither scaled nor stretched",
        size=STRETCHED,
    ),
    Cause(
        words="the recorded pixel size differs from the series' median",
        title="recorded pixel sizes differ",
        action="check the magnification of these images",
        size=0.005,
    ),
    Cause(
        words="differ from those in the files",
        title="the table stands against the files",
        action="check the table (--series_csv) against the headers",
        size=0.01,
    ),
    Cause(
        words="its angles are those of the known tilts",
        title="the specimen is flat: its angles are those of the known tilts",
        action="give a part of the specimen with relief, or trust the tilts that you gave",
        size=WHOLE,
    ),
    Cause(
        words="the displacements do not follow the rotation",
        title="the displacements do not follow the rotation",
        action="check the column displacement_um of the table",
        size=NO_ERROR,
    ),
    Cause(
        words="features stand still while others move",
        title="a background does not turn with the specimen",
        action="leave it out with --masks auto or with masks of your own (--masks_path)",
        size=STRETCHED,
    ),
    Cause(
        words="one of the two is wrong",
        title="the pixel sizes of the series contradict one another",
        action="check the pixel sizes of the series",
        size=0.01,
    ),
)
"""What the stages warn of; a note belongs to the first cause whose words it holds."""


def doubts_from_notes(m: Metrics, said: tuple[str, ...]) -> Iterator[Doubt]:
    """A doubt for each cause that is noted.

    Parameters
    ----------
    said : beginnings of notes that doubts from numbers stand for

    """
    open_notes = [note for note in m.notes if not note.startswith(said)]
    for cause in CAUSES_NOTED:
        found = [note for note in open_notes if cause.words in note]
        open_notes = [note for note in open_notes if note not in found]
        if found:
            sentence = " ".join(f"{note[:1].upper()}{note[1:].rstrip('.')}." for note in found)
            yield Doubt(
                size=cause.size,
                title=cause.title,
                sentence=sentence,
                action=cause.action,
                covers=tuple(found),
            )
