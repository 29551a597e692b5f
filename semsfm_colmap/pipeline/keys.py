"""Keys of the stages: what shapes the results of each, with all that comes before it."""

from __future__ import annotations

from semsfm_colmap.config import Config, options_key
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.record import StageEntry, hash_file, hash_text
from semsfm_colmap.pipeline.stage import Stage


def stage_key(stage: Stage, before: str, project: Project, config: Config) -> str:
    """A key of all that shapes the results of a stage.

    Parameters
    ----------
    before : what it sees of the stages before

    """
    files = [path for path in stage.inputs(project, config) if path.is_file()]
    if files:
        before = hash_text(before, *map(hash_file, files))
    text = [options_key(getattr(config, section)) for section in stage.sections]
    # the seed and nothing else of the top level changes a result
    return hash_text(before, stage.name, str(config.seed), *text)


def standing_key(entry: StageEntry, expected: str) -> str:
    """What later stages see of a stage that is not run now: it counts as it stands.

    Where that is of other options or inputs than it would be now, or nothing at all, they see that:
    a report is of the model and of the mesh, whichever came last.
    """
    if entry.status != "done":
        return hash_text(expected, "nothing")
    if entry.product or entry.key == expected:
        return entry.for_later_stages
    return hash_text(expected, entry.key)
