"""Render a whole series with its truth: the public entry of the package."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from semsfm_colmap.errors import UsageError
from semsfm_colmap.synthetic.options import SynthesizeOptions

BEAM_ENERGY_KEV = 5.0
WORKING_DISTANCE_MM = 10.2


def synthesize(
    output_path: Path | str,
    options: SynthesizeOptions,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Render a series of SEM-like images whose truth is known exactly.

    Writes into `output_path` the images, `truth.json` and `truth.npz` (cameras, angles, what
    departs from the camera model), `mesh.npz` (the very surface that was rendered) and, for the
    clump, `displacement.csv` with the readings of the actuator.

    Parameters
    ----------
    output_path : folder, made where it is missing; its `images` must be empty
    options : what to render
    progress : called with the number of finished images and of all

    Returns
    -------
    The folder with the images.

    Raises
    ------
    MissingDependencyError
        open3d, which casts the rays, is not there.
    UsageError
        The options contradict one another, or the folder holds other images.

    Examples
    --------
    >>> options = SynthesizeOptions(
    ...     scene="field", num_images=3, width_px=64, height_px=64, databar=False, mesh_edge_px=8
    ... )
    >>> images = synthesize(Path("series"), options)
    >>> sorted(path.name for path in images.iterdir())
    ['field_000.png', 'field_001.png', 'field_002.png']

    """
    from semsfm_colmap.io.open3d_library import import_open3d
    from semsfm_colmap.synthetic.databar import BarText, draw_databar
    from semsfm_colmap.synthetic.detector import expose, exposure_of
    from semsfm_colmap.synthetic.files import prepare_folder, write_image, write_truth
    from semsfm_colmap.synthetic.motion import (
        SCENE_DEFAULTS,
        image_rows,
        make_motion,
        random_streams,
        view_of,
    )
    from semsfm_colmap.synthetic.render import make_renderer
    from semsfm_colmap.synthetic.scenes import build_specimen

    if options.supersampling < 1 or options.mesh_edge_px <= 0:
        raise UsageError(
            f"{options.supersampling=}, {options.mesh_edge_px=} but expected at least one ray per"
            " pixel and a positive edge length."
        )
    import_open3d()
    output_path = Path(output_path)
    image_path = prepare_folder(output_path)
    motion_rng, specimen_rng, surface_rng, noise_rng = random_streams(options)
    motion = make_motion(options, motion_rng)
    scale = motion.cameras.scale_px_per_unit
    specimen = build_specimen(options.scene, view_of(options, motion), specimen_rng)
    renderer = make_renderer(specimen, options, float(scale.mean()), surface_rng)
    text = BarText(
        pixel_size_um=motion.unit_um / float(scale.mean()),
        beam_energy_kev=BEAM_ENERGY_KEV,
        working_distance_mm=WORKING_DISTANCE_MM,
        angle_name="tilt" if SCENE_DEFAULTS[options.scene].tilted else "rot",
    )
    num = len(motion.cameras)
    rows = image_rows(options)
    names = [f"{options.scene}_{i:03d}.{options.image_format}" for i in range(num)]
    exposure = 0.0
    for i, (name, frame_rng) in enumerate(zip(names, noise_rng.spawn(num), strict=True)):
        signal, coverage = renderer.frame(
            motion.cameras, i, motion.row_shift_px(i), options.width_px
        )
        exposure = exposure or exposure_of(signal, coverage)
        pixels = expose(
            signal,
            coverage,
            exposure=exposure,
            gain=float(motion.gain[i]),
            psf_px=float(motion.psf_px[i]),
            counts=options.counts,
            rng=frame_rng,
            charging=options.charging,
        )
        if options.databar:
            bar = draw_databar(
                options.width_px,
                options.height_px - rows,
                text,
                angle_deg=float(motion.nominal_deg[i]),
                frame=i,
                num_frames=num,
            )
            pixels = np.concatenate([pixels, bar])
        write_image(image_path / name, pixels, options, text, motion, i)
        if progress is not None:
            progress(i + 1, num)
    write_truth(output_path, options, motion, specimen, names)
    return image_path
