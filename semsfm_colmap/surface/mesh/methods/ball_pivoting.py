"""Ball pivoting [Bernardini et al., IEEE TVCG 5(4), 1999].

A ball of radius r rolls over the points; three points that it touches without holding a fourth
become a triangle. Radii are multiples of b, the median distance to the 8th neighbour, so that they
follow the density. Noise of the size of r breaks the surface into fragments: points are merged and
smoothed before.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.io.open3d_library import import_open3d
from semsfm_colmap.surface.mesh.methods.open3d_cloud import to_open3d
from semsfm_colmap.surface.mesh.methods.task import MeshTask, RawSurface
from semsfm_colmap.surface.options import SurfaceOptions


def make_surface(task: MeshTask, options: SurfaceOptions) -> RawSurface:
    """Triangles over the points themselves; open3d does not turn all of them outside."""
    o3d = import_open3d()
    radii = o3d.utility.DoubleVector(
        [factor * task.spacing for factor in sorted(options.ball_radius_factors)]
    )
    mesh = o3d.geometry.TriangleMesh.create_from_point_cloud_ball_pivoting(
        to_open3d(task.cloud), radii
    )
    return RawSurface(
        vertices=np.array(task.cloud.points),
        faces=np.asarray(mesh.triangles).astype(np.int64),
        colors=task.cloud.colors,
        oriented=False,
    )
