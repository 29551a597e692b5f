"""Scenes and an SEM-like renderer with exact truth."""

from semsfm_colmap.synthetic.options import SynthesizeOptions, example_options
from semsfm_colmap.synthetic.series import synthesize

__all__ = ["SynthesizeOptions", "example_options", "synthesize"]
