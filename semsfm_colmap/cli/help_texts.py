"""What the short help says: purposes of the commands, examples, the options used first."""

from __future__ import annotations

GROUPS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("images to a model", ("reconstruct", "inspect", "merge", "view")),
    ("its stages, one by one", ("extract", "match", "map", "densify", "mesh", "report")),
    ("measure", ("measure", "heightmap", "compare", "goniometer", "segment")),
    ("other programs", ("export", "adopt")),
    ("plan and check", ("plan", "evaluate", "synthesize", "compare-features")),
    ("this installation", ("example", "doctor", "completion")),
)
"""Purposes in the order of `semsfm --help`, and their commands; one that is named nowhere comes
last."""

EXAMPLES: dict[str, tuple[tuple[str, str], ...]] = {
    "reconstruct": (
        ("reconstruct images --output_path project", "all in one go; repeat it to go on"),
        ("reconstruct images --output_path look --quality low", "a quick look first"),
        ("reconstruct images --output_path project --pixel_size_um 0.05", "in micrometres"),
        ("reconstruct tilts.st --output_path project", "an MRC stack"),
    ),
    "extract": (("extract images --output_path project", "a project with keypoints"),),
    "match": (
        ("match project", ""),
        ("match project --matching.overlap 10", "more pairs of a long series"),
    ),
    "map": (
        ("map project", ""),
        ("map project --depth_sign reversed", "after you have looked at both models"),
        ("map --database_path db.db --image_path images --output_path sparse", "any database"),
    ),
    "densify": (("densify project --surface.half_series", "also compare two halves of it"),),
    "mesh": (
        ("mesh project --surface.method poisson", "another method"),
        ("mesh project --segment specimen", "without coil or substrate"),
        ("mesh --colmap_path workspace", "any COLMAP folder"),
    ),
    "report": (("report project", ""),),
    "merge": (("merge first second --output_path both", "the pixel size is that of the first"),),
    "inspect": (
        ("inspect images", "before anything else"),
        ("inspect images --csv table.csv", "to correct by hand and give as --series_csv"),
    ),
    "plan": (
        ("plan --depth_sigma_px 0.3", "before the session"),
        ("plan --project project", "which angles to add"),
    ),
    "segment": (
        ("segment project", ""),
        ("segment project --sphere 0 0 5 20 --as_label coil", "cut by hand"),
        ("segment project --undo", ""),
    ),
    "measure": (
        ("measure project --points a.tif:120,80 a.tif:300,95", "a distance with its sigma"),
        ("measure project", "what measurements.toml asks for"),
    ),
    "view": (
        ("view project", "also while it is made"),
        ("view project --no_browser", "prints the address only"),
    ),
    "goniometer": (("goniometer project --displacement table.csv", ""),),
    "heightmap": (("heightmap project --to x3p,tif", "with ISO 25178 parameters"),),
    "compare": (("compare before after --output_path wear", ""),),
    "export": (
        ("export project --to openmvs", ""),
        ("export project --to 3mf", "for printing"),
    ),
    "adopt": (("adopt project --model_path ba --dry_run", "compare only"),),
    "evaluate": (("evaluate project series", "of `semsfm synthesize series`"),),
    "compare-features": (("compare-features images --output_path study", ""),),
    "synthesize": (
        ("synthesize series --example", "the small one of the README"),
        ("synthesize series --scene field --num_images 13 --range_deg 60", ""),
    ),
    "example": (("example", "about two minutes"), ("example --output_path try", "elsewhere")),
    "doctor": (("doctor", ""), ("doctor --json", "for a script")),
    "completion": (
        ('eval "$(semsfm completion bash)"', "now; in ~/.bashrc: always"),
        ("completion fish > ~/.config/fish/completions/semsfm.fish", ""),
    ),
}
"""Commands without the first word, and what they are for."""

_STAGE = ("--quality", "--config_path", "--force", "--verbose", "--quiet")
FIRST: dict[str, tuple[str, ...]] = {
    "reconstruct": (
        "--output_path", "--quality", "--pixel_size_um", "--series_csv", "--tilt_step_deg",
        "--masks", "--refinement.depth_sign", "--database_path", "--config_path", "--force",
        "--quiet",
    ),
    "extract": (
        "--output_path", "--quality", "--pixel_size_um", "--series_csv", "--masks",
        "--features.max_num_features", "--features.detector", "--config_path", "--force",
    ),
    "match": (
        "--matching.pairs", "--matching.overlap", "--matching.max_ratio",
        "--matching.max_error_px", "--matching.min_num_inliers", *_STAGE,
    ),
    "map": (
        "--refinement.depth_sign", "--refinement.receding_edge", "--refinement.camera_model",
        "--refinement.perspective", "--guided.enabled", *_STAGE,
    ),
    "densify": (
        "--surface.max_depth_map_size_px", "--surface.max_num_depth_maps",
        "--surface.num_neighbors", "--surface.half_series", *_STAGE,
    ),
    "mesh": (
        "--surface.method", "--surface.watertight", "--surface.fill_holes", "--surface.texture",
        "--surface.max_texture_faces", "--segmentation.part", *_STAGE,
    ),
    "report": ("--force", "--quiet", "--verbose"),
    "merge": ("--output_path", "--quality", "--config_path", "--force", "--verbose", "--quiet"),
    "inspect": (
        "--json", "--csv", "--pixel_size_um", "--scale_bar_um", "--series_csv", "--masks",
    ),
    "plan": (
        "--depth_sigma_px", "--depth_sigma_um", "--num_frames", "--total_deg", "--step_deg",
        "--project", "--pixel_size_um", "--plot", "--json",
    ),
    "synthesize": (
        "--scene", "--seed", "--num_images", "--range_deg", "--step_deg", "--width_px",
        "--height_px", "--zoom", "--image_format", "--quiet",
    ),
    "compare-features": (
        "--output_path", "--truth", "--detection.max_num_features", "--verbose", "--quiet",
    ),
}  # fmt: skip
"""Options that a person needs first; of a command that is not named here all that have no
section."""
