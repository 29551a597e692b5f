"""The configuration: one section a stage; TOML in, TOML out; unknown keys refused."""

from __future__ import annotations

import json
import tomllib
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from annotated_types import Ge

from semsfm_colmap.bounds import Checked, Seed
from semsfm_colmap.colmap.options import ExportOptions, SiftOptions
from semsfm_colmap.errors import UsageError
from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.io.atomic import write_text
from semsfm_colmap.matching.guided.options import GuidedOptions
from semsfm_colmap.matching.options import MatchingOptions
from semsfm_colmap.presets import DEFAULT, PRESETS, QUALITIES, Quality
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.segmentation.options import SegmentationOptions
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.tracks.options import TrackOptions

RENAMED_VALUES = {("surface", "method", "ball_pivoting"): "ball-pivoting"}
"""Section, option and value of older configuration files, and what the value is called now."""


@dataclass(frozen=True, kw_only=True)
class FeatureOptions(SiftOptions):
    """Detector and descriptor; `max_num_features` and `upright` hold for all of them."""

    detector: str = "opencv-sift"
    """opencv-sift or sift, which is COLMAP's, both with a descriptor of their own and at the same
    thresholds; adapted shapes and pooling are COLMAP's only. Or harris-laplace, hessian-laplace,
    harris-hessian-laplace, edge-laplace, harris-affine, hessian-affine, harris-hessian-affine, or a
    union of these such as harris-laplace+edge-laplace; affine ones, upright, bear wide steps. In
    unions COLMAP's keypoints are colmap-sift, colmap-sift-affine, colmap-sift-pooled."""
    descriptor: str = "rootsift"
    """Of all other detectors: sift, rootsift, gloh, pca-sift, cc, steerable, differential,
    moments, shape-context. The first two fit COLMAP's descriptor table, the others leave their
    matches only."""

    def contradictions(self) -> list[tuple[str, str]]:
        """Options of COLMAP's SIFT beside another."""
        if self.detector != "opencv-sift":
            return []
        return [
            (name, "that is of COLMAP's SIFT: give --features.detector sift with it")
            for name in ("estimate_affine_shape", "domain_size_pooling")
            if getattr(self, name)
        ]


@dataclass(frozen=True, kw_only=True)
class Config(Checked):
    """All options of a reconstruction.

    Examples
    --------
    >>> config = Config(seed=1)
    >>> config.seed, config.guided.enabled
    (1, True)

    """

    quality: Quality = DEFAULT
    """low, medium, high or extreme: options of several stages at once, from a quick look to the
    most detail; options given beside it stand above it. In Python see `preset`."""
    # on the command line the ingest options go without a prefix: --pixel_size_um, --crop
    ingest: Annotated[IngestOptions, tyro.conf.arg(name="")] = field(default_factory=IngestOptions)
    """Reading and preparing images"""
    features: FeatureOptions = field(default_factory=FeatureOptions)
    """Keypoints and descriptors"""
    matching: MatchingOptions = field(default_factory=MatchingOptions)
    """Pairs and their verification"""
    tracks: TrackOptions = field(default_factory=TrackOptions)
    """Joining matches"""
    factorization: FactorizationOptions = field(default_factory=FactorizationOptions)
    """Initial cameras"""
    guided: GuidedOptions = field(default_factory=GuidedOptions)
    """Second pass with the first model"""
    refinement: RefinementOptions = field(default_factory=RefinementOptions)
    """Filtering, bundle adjustment, hand"""
    export: ExportOptions = field(default_factory=ExportOptions)
    """COLMAP model"""
    surface: SurfaceOptions = field(default_factory=SurfaceOptions)
    """Depth maps and mesh"""
    segmentation: SegmentationOptions = field(default_factory=SegmentationOptions)
    """Specimen and what holds it"""
    seed: Seed = 0
    """Seed of everything random: same seed, same result"""
    num_threads: Annotated[int, Ge(-1)] = -1
    """Threads of feature extraction and matching; -1 for all cores"""
    executor: Literal["local", "dask"] = "local"
    """local: threads of this process; dask: processes, as many as `num_threads` says on this
    machine, or those of a scheduler. The results are the same; the project does not remember it."""
    scheduler_address: str | None = None
    """Of a dask scheduler whose workers see the project under the same path: tcp://HOST:8786"""

    def contradictions(self) -> list[tuple[str, str]]:
        """No threads are none."""
        return [("num_threads", "give -1 or a number above 0")] if self.num_threads == 0 else []


def preset(quality: Quality) -> Config:
    """The options that a quality stands for.

    ``Config.quality`` is what they started from; set by itself it changes nothing.

    Parameters
    ----------
    quality : low, medium, high (the defaults) or extreme; docs/quality.md has times and errors

    Returns
    -------
    the whole configuration

    Raises
    ------
    UsageError
        There is no such quality.

    Examples
    --------
    >>> preset("low").features.first_octave, preset("high") == Config()
    (0, True)

    """
    if quality not in QUALITIES:
        raise UsageError(f"quality = {quality!r} but expected {', '.join(QUALITIES)}")
    return config_from_dict({"quality": quality})


def config_to_dict(config: Config) -> dict[str, Any]:
    """Plain values only, None left out: what TOML can hold."""

    def plain(value: Any) -> Any:
        if isinstance(value, dict):
            return {k: plain(v) for k, v in value.items() if v is not None}
        if isinstance(value, (list, tuple)):
            return [plain(v) for v in value]
        return str(value) if isinstance(value, Path) else value

    result: dict[str, Any] = plain(asdict(config))
    return result


def config_from_dict(data: dict[str, Any], source: str = "the configuration") -> Config:
    """Validate types and names; one sentence for the first thing that is wrong."""
    from pydantic import TypeAdapter, ValidationError

    _refuse_unknown(data, source)
    data = _over_preset(_renamed(data))
    try:
        return TypeAdapter(Config).validate_python(data)
    except UsageError as error:
        raise UsageError(f"{source}: {error}") from error
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise UsageError(f"{source}: {place} = {first.get('input')!r}: {first['msg']}") from error


def _renamed(data: dict[str, Any]) -> dict[str, Any]:
    """Values under the names that they have now: projects of older versions go on."""
    result = dict(data)
    for (section, key, old), new in RENAMED_VALUES.items():
        if data.get(section, {}).get(key) == old:
            result[section] = {**result[section], key: new}
    return result


def _over_preset(data: dict[str, Any]) -> dict[str, Any]:
    """What a configuration says, and below it what its quality does."""
    result = dict(data)
    chosen = data.get("quality", DEFAULT)
    for section, options in (PRESETS[chosen] if chosen in QUALITIES else {}).items():
        result[section] = {**options, **data.get(section, {})}
    return result


def _without_preset(data: dict[str, Any]) -> dict[str, Any]:
    """What a resolved configuration says beyond its own quality: the user's word."""
    common = config_to_dict(config_from_dict({"quality": data.get("quality", DEFAULT)}))
    return {
        key: {name: option for name, option in value.items() if option != common[key].get(name)}
        if isinstance(value, dict)
        else value
        for key, value in data.items()
    }


def _refuse_unknown(data: dict[str, Any], source: str) -> None:
    import difflib

    known = asdict(Config())
    sections = {k: set(v) for k, v in known.items() if isinstance(v, dict)}
    for key, value in data.items():
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise UsageError(f"{source}: unknown key {key}{hint}")
        if key in sections:
            if not isinstance(value, dict):
                raise UsageError(f"{source}: {key} is a section, but {value!r} was given")
            for name in value:
                if name not in sections[key]:
                    near = difflib.get_close_matches(name, sections[key], n=1)
                    hint = f"; did you mean {key}.{near[0]}?" if near else ""
                    raise UsageError(f"{source}: unknown key {key}.{name}{hint}")


def read_config(
    path: Path | str, quality: Quality | None = None, *, resolved: bool = False
) -> Config:
    """Read a TOML file; what it leaves out has the default of its quality.

    Parameters
    ----------
    path : the file; docs/files.md lists what PROJECT/semsfm.toml holds
    quality : in place of the file's; what the file says beyond its own stands above it
    resolved : the file is a project's, in which all options stand

    Returns
    -------
    the whole configuration

    Raises
    ------
    UsageError
        The file cannot be read, is no TOML, or holds a key or value that does not exist; the
        sentence names it and the nearest one that does.

    Examples
    --------
    >>> file = Path("options.toml")
    >>> _ = file.write_text("seed = 3\\n[matching]\\nmax_error_px = 1.5\\n")
    >>> config = read_config(file)
    >>> config.seed, config.matching.max_error_px
    (3, 1.5)
    >>> _ = file.write_text("[matching]\\nmax_eror_px = 1.5\\n")
    >>> read_config(file)
    Traceback (most recent call last):
    semsfm_colmap.errors.UsageError: options.toml: unknown key matching.max_eror_px; did you mean
    matching.max_error_px?

    """
    try:
        data = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UsageError(f"{path} is not valid TOML: {error}") from error
    if quality is not None:
        config_from_dict(data, source=str(path))  # refused as it is, before it is changed
        if resolved or "quality" in data:
            data = _without_preset(_renamed(data))
        data = {**data, "quality": quality}
    return config_from_dict(data, source=str(path))


def write_config(config: Config, path: Path | str) -> None:
    """Write the resolved configuration, aside first, then renamed.

    Parameters
    ----------
    config : all options; those that are None are left out
    path : the TOML file, replaced where it is there

    Raises
    ------
    OSError
        The file cannot be written.

    Examples
    --------
    >>> write_config(Config(seed=3), Path("resolved.toml"))
    >>> read_config(Path("resolved.toml")) == Config(seed=3)
    True

    """
    import tomli_w

    write_text(tomli_w.dumps(config_to_dict(config)), Path(path))


def without_executor(config: Config) -> Config:
    """The options that a project remembers: where a run took place is none of them."""
    return replace(config, executor=Config.executor, scheduler_address=Config.scheduler_address)


def options_key(section: Any) -> str:
    """A section of the configuration as text that changes when any option does."""
    return json.dumps(asdict(section), sort_keys=True, default=str)
