"""Fit the shipped principal components and whitening on rendered SEM images.

    python scripts/fit_projections.py

Writes semsfm_colmap/features/descriptors/projections.npz. The images are rendered by the package
itself, one specimen of each kind, with seeds that no test or benchmark uses.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import cv2
import numpy as np

from semsfm_colmap.features import descriptors
from semsfm_colmap.features.descriptors.projection import (
    FILE_NAME,
    fit_projection,
    write_projections,
)
from semsfm_colmap.features.options import DescriptorOptions, DetectorOptions
from semsfm_colmap.features.registry import DESCRIPTORS, detect, prepare, raw_descriptors
from semsfm_colmap.synthetic import SynthesizeOptions, synthesize

SEED = 1009
FEATURES_PER_IMAGE = 1500


def main() -> None:
    names = [name for name, entry in DESCRIPTORS.items() if entry.projection != "none"]
    values: dict[str, list[np.ndarray]] = {name: [] for name in names}
    with tempfile.TemporaryDirectory() as folder:
        for k, scene in enumerate(("grain", "field", "clump")):
            options = SynthesizeOptions(
                scene=scene, seed=SEED + k, num_images=3, step_deg=25.0, databar=False
            )
            images = synthesize(Path(folder) / scene, options)
            for path in sorted(images.iterdir()):
                prepared = prepare(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))
                for upright in (False, True):
                    detection = DetectorOptions(
                        max_num_features=FEATURES_PER_IMAGE, upright=upright
                    )
                    features = detect("harris-hessian-laplace", prepared, detection)
                    for name in names:
                        values[name].append(
                            raw_descriptors(name, prepared, features, DescriptorOptions())
                        )
    projections = {}
    for name in names:
        entry = DESCRIPTORS[name]
        rows = np.concatenate(values[name])
        projections[name] = fit_projection(rows, entry.projection, entry.dimensions)
        print(name, rows.shape, "->", projections[name].matrix.shape)
    target = Path(descriptors.__file__).parent / FILE_NAME
    write_projections(target, projections)
    print(target, target.stat().st_size)


if __name__ == "__main__":
    main()
