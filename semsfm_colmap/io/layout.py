"""Names of the folders and files of a project: for what writes them, and what must pass them by."""

from __future__ import annotations

IMAGES_FOLDER = "images"
"""Prepared images."""
MASKS_FOLDER = "masks"
"""Masks named <image name>.png, as COLMAP has it; a person's own masks lie in one, too."""
SPARSE_FOLDER = "sparse"
"""COLMAP models."""
DENSE_FOLDER = "dense"
"""Depth maps and the fused cloud."""
MESH_FOLDER = "mesh"
REPORT_FOLDER = "report"
SEGMENTS_FOLDER = "segments"
"""Labelled copies of cloud, mesh and points, and masks of the specimen."""
METROLOGY_FOLDER = "metrology"
"""What was measured on the surface."""
FEATURE_STUDY_FOLDER = "feature_study"
"""Detectors and descriptors compared on its images, where somebody did."""
FOLDERS = (
    IMAGES_FOLDER,
    MASKS_FOLDER,
    SPARSE_FOLDER,
    DENSE_FOLDER,
    MESH_FOLDER,
    REPORT_FOLDER,
    SEGMENTS_FOLDER,
    METROLOGY_FOLDER,
    FEATURE_STUDY_FOLDER,
)

SERIES_FILE = "series.json"
"""The prepared series."""
DATABASE_FILE = "database.db"
"""COLMAP's database."""
CONFIG_FILE = "semsfm.toml"
"""The resolved configuration."""
RECORD_FILE = "run.json"
"""Versions, stage times, seeds, input hashes."""
CUTS_FILE = "segments.toml"
"""Cuts made by hand."""
MEASUREMENTS_FILE = "measurements.toml"
"""What to measure, made by hand."""
GONIOMETER_FILE = "goniometer.json"
"""How the specimen was turned, in the report's folder."""
LOG_FILE = "semsfm.log"
"""What was said while running."""
LOCK_FILE = ".semsfm.lock"
"""Held while a process works on a project. It marks the folder as ours from the first moment,
before there is a run.json: a run that is killed while it prepares the images can be repeated."""
FILES = (SERIES_FILE, DATABASE_FILE, CONFIG_FILE, RECORD_FILE, LOG_FILE, LOCK_FILE)
"""What begins so at the top of a project is written by a run."""
