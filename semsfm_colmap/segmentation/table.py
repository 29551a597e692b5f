"""The table of the parts: names, sizes, confidence."""

from __future__ import annotations

from typing import Any

import numpy as np

from semsfm_colmap.segmentation.labels import Labelling
from semsfm_colmap.segmentation.transfer import face_labels
from semsfm_colmap.types import Float, Int, TriangleMesh


def parts_table(
    labelling: Labelling,
    mesh: TriangleMesh | None,
    mesh_label: Int | None,
    sparse_label: Int | None,
) -> list[dict[str, Any]]:
    """One row a part, JSON-able; what a missing mesh or model would say is None.

    Parameters
    ----------
    labelling : of the cloud
    mesh, mesh_label : the mesh and the labels of its vertices
    sparse_label : labels of the sparse points

    """
    faces = None if mesh is None or mesh_label is None else face_labels(mesh_label, mesh.faces)
    area = None if mesh is None else face_areas(mesh)
    rows = []
    for number in np.unique(labelling.label).tolist():
        part = labelling.label == number
        mine = None if faces is None else faces == number
        rows.append(
            {
                "label": number,
                "name": labelling.names[number],
                "area": None if mine is None or area is None else float(area[mine].sum()),
                "num_faces": None if mine is None else int(mine.sum()),
                "num_points": int(part.sum()),
                "num_sparse_points": None
                if sparse_label is None
                else int(np.sum(sparse_label == number)),
                "confidence": float(labelling.confidence[part].mean()),
            }
        )
    return rows


def face_areas(mesh: TriangleMesh) -> Float:
    """(F,) areas, world units squared."""
    a, b, c = np.swapaxes(mesh.vertices[mesh.faces], 0, 1)
    return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))
