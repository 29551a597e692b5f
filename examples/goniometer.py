"""The actuator that turned the specimen, measured from the images alone.

    python examples/goniometer.py PROJECT [DISPLACEMENTS.csv]

The table has the columns image and displacement_um; without one, what the series recorded is used.
"""

from __future__ import annotations

import sys
from pathlib import Path

import semsfm_colmap as semsfm


def main(project_path: Path, displacement_path: Path | None = None) -> None:
    """Print axis, angles and, with displacements, degrees per um."""
    record = semsfm.measure_rotation(project_path, displacement_path=displacement_path)
    x, y, z = record.axis_camera
    print(
        f"axis ({x:.4f}, {y:.4f}, {z:.4f}) in the camera, +- {record.axis_camera_sigma_deg:.3f} deg"
    )
    print(f"{record.range_deg:.2f} deg in all, wobble {record.wobble_deg_rms:.3f} deg RMS")
    if record.conversion_deg_per_um is not None:
        found = record.conversion_deg_per_um
        print(f"{found.value:.2f} +- {found.sigma:.2f} deg/um from {record.displacement_source}")
    for name, image in record.images.items():
        print(f"  {name}  {image.angle_deg:8.3f} +- {image.sigma_deg:.3f} deg")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]) if len(sys.argv) > 2 else None)
