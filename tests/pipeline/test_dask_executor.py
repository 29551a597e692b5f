"""Processes beside this one: the same bits, whoever dies."""

import functools
import os
import shutil
import signal
import sys
import time
from pathlib import Path

import pytest

from semsfm_colmap.config import config_from_dict, read_config
from semsfm_colmap.errors import ClusterError, InputError, MissingDependencyError, UsageError
from semsfm_colmap.pipeline import dask_executor
from semsfm_colmap.pipeline.dask_executor import DaskExecutor
from semsfm_colmap.pipeline.executor import LOOK_AHEAD, open_executor
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.runner import run_stages
from tests.pipeline.dask_clusters import (
    AfterFirst,
    OwnScheduler,
    files,
    kill_a_worker,
    scheduler_of_threads,
    tables,
)

pytestmark = [
    # sockets and loops of a cluster that is going down are closed by the garbage collector
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning:distributed"),
]
LOCAL = config_from_dict({"num_threads": 2})
COMPARED = ("extract", "match", "map", "densify")


@pytest.fixture(scope="module")
def address():
    with scheduler_of_threads() as address:
        yield address


@pytest.fixture
def executor(address):
    with DaskExecutor(scheduler_address=address, num_processes=2) as executor:
        yield executor


def slow_first(k):
    time.sleep(0.1 if k == 0 else 0.0)
    return k * k


def refuse_three(k):
    if k == 3:
        raise InputError("three is no image")
    return k


def die_once(marker, k):
    """End the process of the first that asks for item 3."""
    if k == 3 and not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return k


def die(k):
    os.kill(os.getpid(), signal.SIGKILL)


def test_results_come_in_the_order_of_the_items(executor):
    assert list(executor.map(slow_first, range(20))) == [k * k for k in range(20)]
    assert list(executor.map(slow_first, [])) == []


def test_functions_that_hold_values_are_sent_with_them(executor):
    assert list(executor.map(functools.partial(pow, 3), [1, 2, 3])) == [3, 9, 27]
    offset = 5
    assert list(executor.map(lambda k: k + offset, [1, 2])) == [6, 7]


def test_an_error_of_the_function_reaches_the_caller_as_it_is(executor):
    with pytest.raises(InputError, match="three is no image"):
        list(executor.map(refuse_three, range(100)))


def test_only_so_many_items_are_taken_before_their_turn(executor):
    taken = []
    results = executor.map(slow_first, (taken.append(k) or k for k in range(100)))
    assert next(results) == 0
    assert len(taken) <= LOOK_AHEAD * executor.num_workers + 1
    results.close()


def test_it_works_elsewhere_with_as_many_as_the_scheduler_has(executor):
    assert executor.num_workers == 2
    assert not executor.shares_memory


def test_keypoints_and_matches_are_those_of_threads_and_the_project_does_not_tell(
    small_series, address, tmp_path
):
    images = small_series / "images"
    names = ("ingest", "extract", "match")
    remote = config_from_dict({"executor": "dask", "scheduler_address": address, "num_threads": 2})
    for name, config in (("here", LOCAL), ("there", remote)):
        run_stages(tmp_path / name, config, names=names, image_path=images)
    here, there = (Project(tmp_path / name) for name in ("here", "there"))
    assert tables(here.database) == tables(there.database)
    assert read_config(there.config) == LOCAL
    said = run_stages(there.path, LOCAL, names=names, image_path=images)
    assert [said.entry(name).key for name in names] == [
        run_stages(here.path, LOCAL, names=names, image_path=images).entry(name).key
        for name in names
    ]


@pytest.mark.parametrize("descriptor", ["rootsift", "cc"])
def test_detectors_of_ours_find_the_same_there(small_series, address, tmp_path, descriptor):
    features = {
        "detector": "harris-laplace",
        "descriptor": descriptor,
        "max_num_features": 300,
        "upright": True,
    }
    common = {"features": features, "num_threads": 2}
    remote = {"executor": "dask", "scheduler_address": address}
    for name, more in (("here", {}), ("there", remote)):
        run_stages(
            tmp_path / name,
            config_from_dict({**common, **more}),
            names=("ingest", "extract", "match"),
            image_path=small_series / "images",
        )
    here, there = (Project(tmp_path / name).database for name in ("here", "there"))
    assert tables(here) == tables(there)
    assert len(tables(here)["matches"]) > 6


def test_no_scheduler_is_one_sentence(monkeypatch):
    monkeypatch.setattr(dask_executor, "CONNECT_S", 0.3)
    with (
        DaskExecutor(scheduler_address="tcp://127.0.0.1:9", num_processes=1) as executor,
        pytest.raises(UsageError, match=r"answers at tcp://127\.0\.0\.1:9: start"),
    ):
        list(executor.map(slow_first, [1]))


def test_a_missing_extra_is_one_sentence(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with (
        DaskExecutor(scheduler_address=None, num_processes=1) as executor,
        pytest.raises(MissingDependencyError, match=r'pip install "semsfm-colmap\[cluster\]"'),
    ):
        list(executor.map(slow_first, [1]))


def test_an_address_without_dask_is_refused():
    config = config_from_dict({"scheduler_address": "tcp://127.0.0.1:8786"})
    with pytest.raises(UsageError, match="of --executor dask: give both"), open_executor(config):
        pass


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        (("0.0.1", None), r"has semsfm-colmap 0\.0\.1 but this is .*: install the same version"),
        ((dask_executor.__version__, None), "does not see .*: put the project into a folder"),
    ],
)
def test_workers_of_another_version_or_without_the_project_are_refused(
    address, tmp_path, monkeypatch, answer, sentence
):
    monkeypatch.setattr(dask_executor, "introduction", lambda path: answer)
    with (
        DaskExecutor(scheduler_address=address, num_processes=1, shared_path=tmp_path) as executor,
        pytest.raises(UsageError, match=sentence),
    ):
        list(executor.map(slow_first, [1]))
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_worker_that_dies_costs_its_item_only_and_one_that_always_dies_is_a_sentence(tmp_path):
    with DaskExecutor(scheduler_address=None, num_processes=2) as executor:
        found = executor.map(functools.partial(die_once, tmp_path / "died"), range(12))
        assert list(found) == list(range(12))
        assert (tmp_path / "died").exists()
        with pytest.raises(ClusterError, match="several workers died at the same piece of work"):
            list(executor.map(die, [1]))


@pytest.mark.slow
def test_processes_of_which_one_is_killed_in_each_step_leave_the_same_bits(small_project, tmp_path):
    here, there = tmp_path / "here", tmp_path / "there"
    for project in (here, there):
        shutil.copytree(small_project, project)
    run_stages(here, LOCAL, names=COMPARED, force=True)
    with DaskExecutor(scheduler_address=None, num_processes=3) as inner:
        killing = AfterFirst(inner, lambda: kill_a_worker(inner))
        run_stages(there, LOCAL, names=COMPARED, force=True, executor=killing)
    # keypoints, matches, verification, guided passes, depth maps, fusion
    assert killing.num_times >= 7
    assert tables(here / "database.db") == tables(there / "database.db")
    assert files(here / "sparse") == files(there / "sparse")
    assert files(here / "dense") == files(there / "dense")
    assert "fused.ply" in files(there / "dense")


@pytest.mark.slow
def test_a_scheduler_that_goes_away_is_one_sentence_and_the_next_run_goes_on(
    small_series, tmp_path, monkeypatch
):
    images, names = small_series / "images", ("ingest", "extract", "match")
    monkeypatch.chdir(tmp_path)
    project, elsewhere = Project(Path("p")), tmp_path / "elsewhere"
    elsewhere.mkdir()
    with OwnScheduler(elsewhere) as cluster:
        address = cluster.address()
        with DaskExecutor(scheduler_address=address, num_processes=1) as inner:
            dying = AfterFirst(inner, cluster.kill_scheduler)
            with pytest.raises(ClusterError, match="the dask scheduler is gone"):
                run_stages(project.path, LOCAL, names=names, image_path=images, executor=dying)
    stored = tables(project.database)["keypoints"]
    assert 1 <= len(stored) < 7
    before = project.database.stat().st_ino
    run_stages(project.path, LOCAL, names=names, image_path=images)
    assert project.database.stat().st_ino == before  # it was filled up, not made anew
    run_stages(tmp_path / "q", LOCAL, names=names, image_path=images)
    assert tables(project.database) == tables(tmp_path / "q" / "database.db")
