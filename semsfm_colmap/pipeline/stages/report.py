"""Everything known -> report/."""

from __future__ import annotations

from typing import TYPE_CHECKING

from semsfm_colmap.io.layout import GONIOMETER_FILE
from semsfm_colmap.pipeline.feature_study import TABLE as STUDY_TABLE
from semsfm_colmap.pipeline.stage import Stage, StageRun, files_in
from semsfm_colmap.records import DensifyRecord, MapRecord, MatchRecord, ReportRecord

if TYPE_CHECKING:
    from semsfm_colmap.config import Config
    from semsfm_colmap.pipeline.project import Project
    from semsfm_colmap.pipeline.record import RunRecord
    from semsfm_colmap.report.inputs import ReportInputs


def run(on: StageRun) -> ReportRecord:
    """Gather what the stages have left, and write the report."""
    from semsfm_colmap.report.metrics_json import metrics_json
    from semsfm_colmap.report.write import write_report

    project = on.project
    inputs = gather_inputs(project, on.record, config=on.config)
    with on.reporter.progress("report") as progress:
        metrics = write_report(inputs, project.report, parallel_map=on.local.map, progress=progress)
    on.reporter.say(f"report: {project.report / 'report.html'}")
    return ReportRecord(num_metrics=len(metrics_json(metrics)))


def gather_inputs(
    project: Project, record: RunRecord, *, surface: bool = True, config: Config | None = None
) -> ReportInputs:
    """What the stages of a project have left, as the report needs it.

    Parameters
    ----------
    surface : read cloud and mesh too, which are large
    config : the project's, where a page is made of it: images, depth maps and texture too

    """
    from semsfm_colmap.io.ply import read_ply_cloud, read_ply_mesh
    from semsfm_colmap.pipeline.feature_study import read_feature_study
    from semsfm_colmap.pipeline.goniometer import read_goniometer
    from semsfm_colmap.pipeline.record import versions
    from semsfm_colmap.pipeline.report_evidence import read_evidence
    from semsfm_colmap.pipeline.viewer_inputs import read_viewer_inputs
    from semsfm_colmap.report.inputs import ReportInputs, StageUsage, ViewerInputs

    reconstruction = project.read_main_model()
    mapped = record.result("map", MapRecord)
    matched = record.result("match", MatchRecord)
    densified = record.result("densify", DensifyRecord)
    # the report says itself what the series and the verdict on the hand say
    said = [n for n in record.notes() if n != reconstruction.depth_sign.message]
    goniometer = read_goniometer(project)
    if goniometer is None and (project.report / GONIOMETER_FILE).is_file():
        said.append(
            f"report/{GONIOMETER_FILE} is of another model and is not shown: run `semsfm "
            "goniometer` again"
        )
    viewer, evidence = ViewerInputs(), None
    if config is not None:
        viewer, without = read_viewer_inputs(project)
        said += [without] if without else []
        evidence = read_evidence(project, record, config)
    mesh_file, cloud_file = project.mesh / "mesh.ply", project.dense / "fused.ply"
    return ReportInputs(
        reconstruction=reconstruction,
        series=project.read_series(),
        pairs=() if matched is None else matched.pairs,
        stages=tuple(
            StageUsage(name=name, seconds=entry.seconds, peak_memory_mb=entry.peak_memory_mb)
            for name, entry in record.stages.items()
            if name != STAGE.name
        ),
        notes=tuple(dict.fromkeys(said)),
        rounds=() if mapped is None else mapped.rounds,
        guided=None if mapped is None else mapped.diagnostics.guided,
        reliability=None if mapped is None else mapped.reliability,
        tilt=None if mapped is None else mapped.diagnostics.tilt,
        goniometer=goniometer,
        mesh=read_ply_mesh(mesh_file) if surface and mesh_file.is_file() else None,
        cloud=read_ply_cloud(cloud_file) if surface and cloud_file.is_file() else None,
        surface_halves=None if densified is None else densified.half_series,
        viewer=viewer,
        feature_study=read_feature_study(project),
        evidence=evidence,
        versions=versions(),
        models=() if mapped is None else mapped.models,
        title=project.path.resolve().name,
    )


STAGE = Stage(
    name="report",
    help="metrics and HTML report of a project",
    description="Metrics and HTML report.",
    sections=(),
    outputs=lambda p: [p.report / "report.html", p.report / "metrics.json"],
    writes=lambda p: files_in(p.report / "figures"),
    run=run,
    inputs=lambda p, _: [p.report / GONIOMETER_FILE, p.feature_study / STUDY_TABLE],
)
