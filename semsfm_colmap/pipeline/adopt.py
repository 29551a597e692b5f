"""Taking over a model that COLMAP has changed."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np

from semsfm_colmap.bounds import CountOrNone, hold
from semsfm_colmap.colmap.adoption import (
    ModelChange,
    compare_models,
    old_origin,
    with_names_of,
)
from semsfm_colmap.colmap.database.work import DatabaseImage
from semsfm_colmap.colmap.model.pinhole_reading import read_pinhole_model
from semsfm_colmap.colmap.model.sidecar import FILE_NAME, read_sidecar
from semsfm_colmap.colmap.model.sparse import read_model, write_model
from semsfm_colmap.colmap.options import AdoptionOptions
from semsfm_colmap.config import Config, read_config
from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.pipeline.foreign.workspace import find_model
from semsfm_colmap.pipeline.outputs import fingerprints
from semsfm_colmap.pipeline.project import Project, locked, open_project
from semsfm_colmap.pipeline.record import RunRecord
from semsfm_colmap.pipeline.registry import find_stage, stages_after

KEPT = "sparse_before_adoption"
"""Folder of the project that keeps the model that was replaced."""


def adopt_model(
    project_path: Path | str,
    changed_path: Path | str,
    *,
    model: int = 0,
    options: AdoptionOptions | None = None,
    dry_run: bool = False,
) -> ModelChange:
    """Compare a changed model with the project's and take it over, or refuse it with the reason.

    Parameters
    ----------
    project_path : the project folder
    changed_path : COLMAP model folder, binary or text, or a workspace around it; images may have
        other suffixes there, or lie in other folders
    model : number of the model below sparse/ that it comes from
    options : how much change is acceptable
    dry_run : only compare; nothing is written and nothing raised for a refusal

    Returns
    -------
    how far cameras and points have moved, whether that is accepted, and the reasons if not

    Raises
    ------
    InputError
        There is no such model, or the changed one is refused; the sentence lists the reasons.
    UsageError
        `changed_path` is the project's own model.

    """
    options = options or AdoptionOptions()
    hold("model", model, CountOrNone)
    project = open_project(project_path)
    target = project.sparse / str(model)
    changed_path = Path(changed_path)
    if not target.is_dir():
        raise InputError(f"{target} does not exist: run `semsfm map` first")
    if not changed_path.is_dir():
        raise UsageError(f"{changed_path} is not a folder: give the one of the changed model")
    changed_path = find_model(changed_path)
    if changed_path.resolve() == target.resolve():
        raise UsageError(
            f"{changed_path} is the project's own model: let COLMAP write to another folder"
        )
    old = read_model(target)
    focal = float(read_sidecar(target / FILE_NAME)["telecentric"]["focal_length_px"])
    reading = with_names_of(old, read_pinhole_model(changed_path))
    reference = old_origin(old, reading)
    reading = with_names_of(old, read_pinhole_model(changed_path, reference=reference))
    change, new = compare_models(old, focal, reading, options)
    if dry_run:
        return change
    if not change.accepted:
        raise InputError(f"refused: {'; '.join(change.reasons)}")
    config = read_config(project.config) if project.config.is_file() else Config()
    images = {
        name: DatabaseImage(image_id=row.image_id, name=name, camera_id=row.camera_id)
        for name, row in reading.rows.items()
    }
    keypoints = {name: row.keypoints for name, row in reading.rows.items()}
    with locked(project):
        kept = project.path / KEPT / str(model)
        shutil.rmtree(kept, ignore_errors=True)
        shutil.copytree(target, kept)
        write_model(new, target, images, keypoints, config.export)
        _mark(project, model, change)
    return change


def _mark(project: Project, model: int, change: ModelChange) -> None:
    """Note it in run.json, and what depends on the first model as to be redone."""
    if not project.record.is_file():
        return
    record = RunRecord.read(project.record)
    note = (
        f"Model {model} was changed by COLMAP and adopted: its cameras turned by at most "
        f"{float(np.max(change.rotation_deg)):.3g} degrees; the error bars of the first solution "
        "do not hold for it and were dropped."
    )
    entry = record.entry("map")
    left = fingerprints(find_stage("map"), project, entry.outputs)
    record.stages["map"] = replace(entry.with_note(note), outputs=left)
    if model == 0:
        for name in stages_after("map"):
            if name in record.stages:
                record.stages[name] = replace(record.stages[name], status="stale", key="")
    record.write()
