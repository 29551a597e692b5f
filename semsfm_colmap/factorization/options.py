"""Options of the factorization stage."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge

from semsfm_colmap.bounds import Checked, Count, CountOrNone, Positive


@dataclass(frozen=True, kw_only=True)
class FactorizationOptions(Checked):
    """Camera basis constraints, affine polish and Euclidean upgrade."""

    min_block_images: Annotated[int, Ge(2)] = 3
    """Fewest images of a complete sub-block."""
    max_block_images: Annotated[int, Ge(2)] = 6
    """Most images of a complete sub-block."""
    min_block_tracks: Annotated[int, Ge(4)] = 10
    """Fewest tracks that all images of a sub-block must share."""
    max_block_tracks: Annotated[int, Ge(4)] = 500
    """A block with more tracks is thinned to so many, evenly: more do not make it better."""
    num_block_neighbours: Count = 6
    """From every image blocks grow toward so many neighbours, from the one that shares the most
    tracks to the last one that shares enough."""
    gauge: Literal["orthonormal", "two_cameras"] = "orthonormal"
    """How the joint projection matrix is fixed: by its three smallest eigenvectors, or as the
    paper's equation 15 fixes two cameras."""
    block_weights: Literal["signal_to_noise", "uniform"] = "signal_to_noise"
    """Weight of a block: sigma_3^2 / mean(sigma_4..^2), or one for all."""
    block_ransac_threshold_px: Positive = 3.0
    """Residual up to which a track supports a block's subspace."""
    block_ransac_trials: CountOrNone = 100
    """Random 4-track subspaces tried per block."""
    polish_loss: Literal["squared", "huber", "cauchy"] = "cauchy"
    """Loss of the affine polish."""
    polish_loss_width_px: Positive = 1.0
    """Where the loss of the affine polish bends."""
    polish_iterations: CountOrNone = 30
    """Most steps of the affine polish."""
    scale_sigma: Positive = 0.01
    """How far, relative, the magnifications of two images may differ in the Euclidean upgrade."""

    def contradictions(self) -> list[tuple[str, str]]:
        """No block has more at least than at most."""
        return [
            (f"max_block_{what}", f"give at least min_block_{what}, {least}")
            for what, least, most in (
                ("images", self.min_block_images, self.max_block_images),
                ("tracks", self.min_block_tracks, self.max_block_tracks),
            )
            if most < least
        ]
