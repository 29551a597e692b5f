"""The commands and Python blocks of the pages for users run as they stand.

README, start page, tutorial and how-to, in a folder that has what they name: IMAGES, PROJECT and so
on, of a small rendered series.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import cv2
import mrcfile
import numpy as np
import pytest

from semsfm_colmap.cli.main import main
from tests.docs.blocks import OTHERS, PAGES, ROOT, Block, blocks_of, commands_of, of

RUN = ("README.md", "docs/index.md", "docs/tutorial/", "docs/how-to/")
"""Pages whose commands are run."""
NOT_RUN = {
    "semsfm example": "24 images take two minutes; tests/cli has it on a small series",
    "semsfm synthesize SERIES --example": "24 images take a minute; tests/cli runs it",
    "semsfm reconstruct SERIES/images": "the same",
    "semsfm evaluate EXAMPLE": "the same",
    "semsfm plan --depth_sigma_px": "a search of some seconds; tests/cli/test_plan.py runs it",
    "semsfm reconstruct IMAGES --output_path PROJECT --": "another option, minutes of work",
    "semsfm map PROJECT --depth_sign": "changes the model of the blocks that follow",
    "semsfm adopt PROJECT --model_path CHANGED": "CHANGED is made by COLMAP; tests/pipeline has it",
    "semsfm compare BEFORE AFTER": "a whole grain has no height map; tests/pipeline has fields",
    "semsfm reconstruct tilts.st": "a whole reconstruction; tests/ingest has the stacks",
    "semsfm export TILTS": "its export; tests/exports has it on a ball",
    "semsfm match TILTS": "the same",
    "semsfm map TILTS": "the same",
    "semsfm reconstruct IMAGES --database_path": "a whole reconstruction; tests/pipeline has it",
}
"""Beginnings of the commands of these pages that are parsed only, and why."""
SLOW = (
    "docs/commands.md",
    "docs/features.md",
    "docs/how-to/cluster.md",
    "docs/how-to/meshlab.md",
    "docs/how-to/own_matches.md",
    "docs/how-to/printing.md",
    "docs/tutorial/",
)
"""Of the pages whose code is run, those that take more than a few seconds."""
USER_PAGES = [path for path in PAGES if path.relative_to(ROOT).as_posix().startswith(RUN)]
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")


@pytest.fixture
def workshop(small_series: Path, small_project: Path, tmp_path: Path) -> Path:
    """A folder that has what the pages name: IMAGES, PROJECT and files beside them."""
    folder = tmp_path
    for name in ("IMAGES", "images"):
        # the very images of the project, so that nothing is to be done again
        (folder / name).symlink_to(small_series / "images", target_is_directory=True)
    for name in ("PROJECT", "project"):
        shutil.copytree(small_project, folder / name)
    shutil.copy(small_project / "database.db", folder)
    stack = np.stack(
        [cv2.imread(str(p), 0) for p in sorted((folder / "PROJECT" / "images").iterdir())]
    )
    with mrcfile.new(folder / "tilts.st") as file:
        file.set_data(stack[:, ::-1].astype(np.uint8).view(np.int8))
    return folder


def is_run(block: Block) -> bool:
    """Whether the commands of a block are run."""
    return block.page.startswith(RUN)


def marked(what: Path | Block) -> object:
    """A page or a block as a parameter of a test, marked where it is slow."""
    name = what.page if isinstance(what, Block) else what.relative_to(ROOT).as_posix()
    marks = [pytest.mark.slow] if name.startswith(SLOW) else []
    return pytest.param(what, id=name, marks=marks)


def steps_of(page: Path) -> Iterator[tuple[Block, list[str] | None]]:
    """The commands of a page in their order; a Python block is a step without words."""
    for block in blocks_of(page):
        if block.language == "python":
            yield block, None
        elif block.language == "sh" and block.title != OTHERS:
            yield from ((block, words) for words in commands_of(block.text))


def reason_not_to_run(words: list[str]) -> str | None:
    """Why a command is parsed only."""
    line = " ".join(words)
    return next((why for start, why in NOT_RUN.items() if line.startswith(start)), None)


@pytest.mark.parametrize("page", [marked(page) for page in USER_PAGES])
def test_the_pages_for_users_run_as_they_stand(page, workshop, monkeypatch, capsys):
    monkeypatch.chdir(workshop)
    for block, words in steps_of(page):
        if words is None:
            exec(compile(block.text, str(block), "exec"), {"__name__": "__main__"})
        elif words[0] == "semsfm" and reason_not_to_run(words) is None:
            code = main(words[1:])
            assert code == 0, f"{block}: {' '.join(words)}: {capsys.readouterr().err}"


def test_what_is_not_run_is_there_and_is_ours():
    lines = [
        " ".join(words) for page in USER_PAGES for _, words in steps_of(page) if words is not None
    ]
    for start in NOT_RUN:
        assert any(line.startswith(start) for line in lines), f"{start} is on no page any more"


@pytest.mark.parametrize("block", [marked(b) for b in of("python") if not is_run(b)])
def test_other_python_blocks_run(block, workshop, monkeypatch):
    monkeypatch.chdir(workshop)
    image = cv2.imread(str(next((workshop / "PROJECT" / "images").iterdir())), cv2.IMREAD_GRAYSCALE)
    names = {"__name__": "__main__", "image": image, "mask": np.ones(image.shape, bool)}
    exec(compile(block.text, str(block), "exec"), names)
