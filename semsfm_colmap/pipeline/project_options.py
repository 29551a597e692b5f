"""The options that a project was made with: a second run that does not say them keeps them."""

from __future__ import annotations

import tomllib
from typing import Any

from semsfm_colmap.config import Config, config_from_dict, config_to_dict, preset, read_config
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.record import RunRecord
from semsfm_colmap.pipeline.reporter import Reporter
from semsfm_colmap.presets import Quality


def read_project_options(
    project: Project, quality: Quality | None = None, reporter: Reporter | None = None
) -> Config | None:
    """The options of semsfm.toml; of run.json where that file is damaged; None of no project.

    Parameters
    ----------
    quality : in place of the project's; what was said beyond its own stands above it
    reporter : told which options are kept, and of damage

    Raises
    ------
    UsageError
        semsfm.toml holds what does not exist, and no run has left it so.

    """
    kept = RunRecord.read(project.record).options
    if not kept and not project.config.is_file():
        return None
    if not kept or is_complete(project, kept):
        config = read_config(project.config, quality, resolved=True)
    else:
        if reporter is not None:
            reporter.warn(
                f"{project.config} is missing or damaged: the options of the last run are taken "
                "from run.json"
            )
        config = config_from_dict(kept, source=str(project.record))
        if quality is not None:
            config = over_quality(config, quality)
    if reporter is not None and (named := beyond_quality(config)):
        reporter.say(f"options kept from {project.config}: {', '.join(named)}")
    return config


def is_complete(project: Project, kept: dict[str, Any]) -> bool:
    """Whether semsfm.toml holds every option that the last run has left in it, with any value.

    What is cut at the end of a line is TOML still, and would stand for the defaults.
    """
    try:
        data = tomllib.loads(project.config.read_text(encoding="utf-8"))
    except (OSError, tomllib.TOMLDecodeError, UnicodeDecodeError):
        return False
    # an option that is None by default is left out, or a person may have taken it away
    always = config_to_dict(Config())
    for key, value in always.items():
        if key in kept and key not in data:
            return False
        names = value.keys() & kept[key].keys() if isinstance(value, dict) and key in kept else ()
        if any(name not in data[key] for name in names):
            return False
    return True


def over_quality(config: Config, quality: Quality) -> Config:
    """The options of another quality, with what was said beyond the old one above it."""
    data: dict[str, Any] = {"quality": quality}
    for section, options in differences(config).items():
        data[section] = options
    return config_from_dict(data)


def differences(config: Config) -> dict[str, Any]:
    """What a configuration says beyond its quality, by section."""
    common, own = config_to_dict(preset(config.quality)), config_to_dict(config)
    found: dict[str, Any] = {}
    for key, value in own.items():
        if not isinstance(value, dict):
            if value != common.get(key):
                found[key] = value
            continue
        section = {k: v for k, v in value.items() if v != common[key].get(k)}
        if section:
            found[key] = section
    return found


def beyond_quality(config: Config) -> list[str]:
    """The same as words: ``surface.method = poisson``."""
    words = [] if config.quality == Config.quality else [f"quality = {config.quality}"]
    for key, value in differences(config).items():
        if isinstance(value, dict):
            words += [f"{key}.{name} = {option}" for name, option in value.items()]
        else:
            words.append(f"{key} = {value}")
    return words
