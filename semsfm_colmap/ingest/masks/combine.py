"""Put the masks of a series together: given ones, burnt-in writing, specimen, motion.

A pixel is used if every kind of mask that is asked for leaves it. Masks must not take a specimen
away in silence, so their effect on area and texture is collected and said.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from semsfm_colmap.ingest.files.raster import RawImage
from semsfm_colmap.ingest.frame.overlay import GROW_PX, Overlay
from semsfm_colmap.ingest.frame.source import SourceImage
from semsfm_colmap.ingest.masks.foreground import MIN_TEXTURE_KEPT, find_foreground, texture_kept
from semsfm_colmap.ingest.masks.given import given_mask
from semsfm_colmap.ingest.masks.static import find_static, reduced
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.io.wording import abbreviate
from semsfm_colmap.types import Array, Bool


@dataclass(frozen=True, kw_only=True)
class MaskEffect:
    """What the mask of one image leaves out."""

    area: float
    texture: float


def grown(drawn: Bool) -> Bool:
    """A mask of writing with a margin: features beside it would see it."""
    import cv2

    window = np.ones((2 * GROW_PX + 1,) * 2, np.uint8)
    return np.asarray(cv2.dilate(drawn.astype(np.uint8), window) > 0)


class SeriesMasks:
    """Collects the masks of a series frame by frame; bits are packed to keep many in memory."""

    def __init__(
        self,
        options: IngestOptions,
        given_folder: Path | None,
        overlays: Mapping[tuple[int, int], Overlay],
    ) -> None:
        self.options = options
        self.given_folder = given_folder
        self.overlays = overlays if options.masks != "off" else {}
        self.packed: dict[str, tuple[Array, tuple[int, int]]] = {}
        self.small: dict[str, Array] = {}
        self.effects: dict[str, MaskEffect] = {}
        self.given: set[str] = set()
        self.coloured: list[str] = []
        self.transparent: list[str] = []
        self.no_foreground: dict[str, str] = {}
        self.warnings: list[str] = []

    def add(
        self, image: SourceImage, name: str, grey: Array, raw: RawImage | None = None
    ) -> list[str]:
        """Take a prepared image in, and its source; returns sentences about its given mask."""
        usable = np.ones(grey.shape, dtype=bool)
        x0, y0, x1, y1 = image.crop
        warnings = []
        if self.given_folder is not None:
            mask, problem = given_mask(self.given_folder, image, self.options)
            warnings += [problem] if problem else []
            if mask is not None:
                usable &= mask
                self.given.add(name)
        overlay = self.overlays.get(image.size)
        if overlay is not None:
            usable &= ~overlay.writing[y0:y1, x0:x1]
        if raw is not None and raw.transparent is not None and self.options.masks != "off":
            transparent = raw.transparent[y0:y1, x0:x1]
            if transparent.any() and not transparent.all():
                usable &= ~transparent
                self.transparent.append(name)
        if raw is not None and raw.coloured is not None and self.options.masks != "off":
            drawn = grown(raw.coloured[y0:y1, x0:x1])
            if drawn.any():
                usable &= ~drawn
                self.coloured.append(name)
        if self.options.masks in ("foreground", "auto") and name not in self.given:
            found = find_foreground(grey)
            if found.mask is None:
                self.no_foreground[name] = found.reason
            else:
                usable &= found.mask
        if self.options.masks in ("motion", "auto"):
            self.small[name] = reduced(grey)
        self._keep(name, usable, grey)
        return warnings

    def finish(self) -> dict[str, Bool]:
        """The masks of the images that have one, by image name."""
        if self.small:
            self._apply_motion()
        self._summarise()
        return {name: self._unpacked(name) for name in self.packed if self.effects[name].area > 0}

    def _apply_motion(self) -> None:
        """Leave out what stands still, in the largest group of frames of one size."""
        import cv2

        groups: dict[tuple[int, ...], list[str]] = {}
        for name, small in self.small.items():
            groups.setdefault(small.shape, []).append(name)
        names = max(groups.values(), key=len)
        scene = find_static([self.small[name] for name in names])
        if scene.masks is None:
            self.warnings.append(f"no mask from motion: {scene.reason}.")
            return
        for name, moving in zip(names, scene.masks, strict=True):
            if name in self.given:
                continue
            usable = self._unpacked(name)
            size = (usable.shape[1], usable.shape[0])
            full = cv2.resize(moving.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
            self._keep(name, usable & full, None)

    def _keep(self, name: str, usable: Bool, grey: Array | None) -> None:
        self.packed[name] = (np.packbits(usable), usable.shape)
        area = float(1 - usable.mean())
        if grey is not None:
            texture = 1 - texture_kept(grey, usable) if area > 0 else 0.0
        else:
            texture = 1 - texture_kept(self.small[name], self._reduced_mask(name))
        self.effects[name] = MaskEffect(area=area, texture=texture)

    def _reduced_mask(self, name: str) -> Bool:
        return np.asarray(reduced(self._unpacked(name).astype(np.uint8) * 255) >= 128)

    def _unpacked(self, name: str) -> Bool:
        bits, shape = self.packed[name]
        return np.unpackbits(bits, count=shape[0] * shape[1]).reshape(shape).astype(bool)

    def _summarise(self) -> None:
        """Say what the masks do, and where none could be made."""
        used = {name: effect for name, effect in self.effects.items() if effect.area > 0}
        if used:
            areas = np.array([effect.area for effect in used.values()])
            textures = np.array([effect.texture for effect in used.values()])
            self.warnings.append(
                f"masks leave out {areas.mean():.1%} of the area of {len(used)} images "
                f"({areas.min():.1%} to {areas.max():.1%}) with {textures.mean():.1%} of their "
                "texture."
            )
            much = [n for n, e in used.items() if e.texture > 1 - MIN_TEXTURE_KEPT]
            if much:
                self.warnings.append(
                    f"{abbreviate(much)}: the mask takes away more than "
                    f"{1 - MIN_TEXTURE_KEPT:.0%} of the texture; check that the specimen is in it."
                )
        if self.no_foreground:
            reasons = sorted(set(self.no_foreground.values()))
            self.warnings.append(
                f"{abbreviate(list(self.no_foreground))}: no automatic mask ({reasons[0]})."
            )
        if self.coloured:
            self.warnings.append(
                f"{abbreviate(self.coloured)}: what is drawn in colour over the image is masked."
            )
        if self.transparent:
            self.warnings.append(f"{abbreviate(self.transparent)}: what is transparent is masked.")
        if self.overlays:
            part = max(float(overlay.writing.mean()) for overlay in self.overlays.values())
            self.warnings.append(f"writing burnt into the images ({part:.1%} of them) is masked.")
