"""Compare a reconstruction with the truth of a synthetic series, after alignment."""

from semsfm_colmap.evaluation.compare import evaluate
from semsfm_colmap.evaluation.table import format_evaluation
from semsfm_colmap.evaluation.truth import Truth, load_truth

__all__ = ["Truth", "evaluate", "format_evaluation", "load_truth"]
