from __future__ import annotations

import os
import shutil
import signal
from collections.abc import Callable
from pathlib import Path

import pytest
from filelock import FileLock

from semsfm_colmap.config import Config
from semsfm_colmap.pipeline.runner import reconstruct
from semsfm_colmap.synthetic.options import SynthesizeOptions
from semsfm_colmap.synthetic.series import synthesize

DATA = Path(__file__).parents[1] / ".." / "shared" / "data"
CASES = DATA.parent / "cases"


def pytest_configure() -> None:
    """Let an interrupt arrive where the run was begun in the background, which ignores it."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def data_path() -> Path:
    """The development data beside the repository; tests that need it are marked `data`."""
    if not DATA.is_dir():
        pytest.skip("the development data are not there")
    return DATA


@pytest.fixture(scope="session")
def cases_path() -> Path:
    """Small inputs that came out wrong once, beside the data; tests of them are marked `data`."""
    if not CASES.is_dir():
        pytest.skip("the cases are not there")
    return CASES


SMALL = SynthesizeOptions(
    scene="grain",
    num_images=7,
    step_deg=5.0,
    width_px=420,
    height_px=360,
    databar_rows=30,
    supersampling=1,
    mesh_edge_px=3.0,
    image_format="tif",
)


def made_once(
    tmp_path_factory: pytest.TempPathFactory, name: str, make: Callable[[Path], object]
) -> Path:
    """A folder that the workers of a run have together: the first that asks makes it.

    What others read at the same time must not be written, or locked, by anybody.
    """
    base = tmp_path_factory.getbasetemp()
    # the temporary folder of a worker is in that of the run
    root = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    path = root / name
    with FileLock(root / f"{name}.lock"):
        if not path.is_dir():
            unfinished = root / f"{name}.part"
            shutil.rmtree(unfinished, ignore_errors=True)
            make(unfinished)
            unfinished.rename(path)
    return path


@pytest.fixture(scope="session")
def small_series(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Seven small TIFFs of a spiny grain with truth beside them, which tests only read."""
    return made_once(tmp_path_factory, "small_series", lambda path: synthesize(path, SMALL))


@pytest.fixture(scope="session")
def small_project(small_series: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The project made from them; tests that change it copy it first."""
    made = made_once(
        tmp_path_factory,
        "small_project",
        lambda path: reconstruct(small_series / "images", path, Config()),
    )
    # a worker has its own: commands that only read lock it too
    return Path(shutil.copytree(made, tmp_path_factory.mktemp("project") / "p"))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The order of the files, so that no worker waits: `loadfile` gives them out from the first.

    One file makes the small project (and numba's cache on a clean clone, which takes a minute)
    while the other worker is busy with files that need none. Of each kind those with slow tests
    come first.
    """
    needing: dict[Path, bool] = {}
    slow: dict[Path, bool] = {}
    for item in items:
        path = item.path
        needing[path] = needing.get(path, False) or "small_project" in fixtures_of(item)
        slow[path] = slow.get(path, False) or item.get_closest_marker("slow") is not None
    first = next((path for path in needing if needing[path] and not slow[path]), None)
    items.sort(key=lambda item: (item.path != first, needing[item.path], not slow[item.path]))


def fixtures_of(item: pytest.Item) -> list[str]:
    """The names of the fixtures that a test asks for, through others too."""
    return list(getattr(item, "fixturenames", ()))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An empty image folder."""
    path = tmp_path / "images_in"
    path.mkdir()
    return path
