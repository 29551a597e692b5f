"""What another process does, and that this one outlives it."""

from __future__ import annotations

import itertools
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from semsfm_colmap.errors import SemSfmError
from semsfm_colmap.io import apart
from semsfm_colmap.io.apart import Allowance, DiedError, call_apart

PLENTY = Allowance(seconds=60, num_bytes=1 << 30)
TELL_AND_WAIT = """
import os, sys, time
from pathlib import Path
from semsfm_colmap.io.apart import Allowance, call_apart
if {closed}:
    for number in (0, 1, 2):
        os.close(number)
found = call_apart(Allowance(seconds=60, num_bytes=1 << 30), os.getpid)
Path(sys.argv[1] + ".part").write_text(str(found))
os.rename(sys.argv[1] + ".part", sys.argv[1])
if not {closed}:
    call_apart(Allowance(seconds=60, num_bytes=1 << 30), time.sleep, 0.5)
    os.kill(os.getpid(), 9)
"""


def lives(process: int) -> bool:
    """Whether a process is there and not only waits to be forgotten."""
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"


def test_it_is_another_process_and_the_same_one_each_time() -> None:
    first = call_apart(PLENTY, os.getpid)
    assert first != os.getpid()
    assert call_apart(PLENTY, os.getpid) == first


def test_what_a_call_raises_is_raised_here_and_the_process_goes_on() -> None:
    before = call_apart(PLENTY, os.getpid)
    with pytest.raises(ValueError, match="invalid literal"):
        call_apart(PLENTY, int, "x")
    assert call_apart(PLENTY, os.getpid) == before


def test_a_process_that_dies_is_said_with_its_signal_and_the_next_call_has_a_new_one() -> None:
    before = call_apart(PLENTY, os.getpid)
    with pytest.raises(DiedError, match="SIGABRT"):
        call_apart(PLENTY, os.abort)
    assert call_apart(PLENTY, os.getpid) not in (before, os.getpid())
    with pytest.raises(DiedError, match="exit code 7"):
        call_apart(PLENTY, os._exit, 7)


def test_a_process_that_was_ended_from_outside_costs_no_call() -> None:
    os.kill(call_apart(PLENTY, os.getpid), signal.SIGKILL)
    assert call_apart(PLENTY, int, "3") == 3


def test_a_call_without_end_is_ended() -> None:
    with pytest.raises(DiedError, match="too much processor time"):
        call_apart(Allowance(seconds=0, num_bytes=1 << 30), sum, itertools.count())


def test_time_counts_from_the_call_on_and_not_from_the_first() -> None:
    worker = call_apart(PLENTY, os.getpid)
    for _ in range(3):
        call_apart(Allowance(seconds=1, num_bytes=1 << 30), sum, range(20_000_000))
    assert call_apart(PLENTY, os.getpid) == worker


def test_memory_beyond_the_allowance_is_refused() -> None:
    with pytest.raises(MemoryError):
        call_apart(Allowance(seconds=60, num_bytes=1 << 25), bytearray, 1 << 27)
    assert len(call_apart(PLENTY, bytearray, 1 << 27)) == 1 << 27


def test_threads_get_their_own_answers_from_no_more_processes_than_cores() -> None:
    with ThreadPoolExecutor(12) as threads:
        found = list(threads.map(lambda k: call_apart(PLENTY, pow, k, 2), range(100)))
        workers = set(threads.map(lambda _: call_apart(PLENTY, os.getpid), range(100)))
    assert found == [k**2 for k in range(100)]
    assert len(workers) <= (os.cpu_count() or 1)


def test_the_answer_of_an_interrupted_call_is_not_taken_for_that_of_the_next() -> None:
    main = threading.main_thread().ident
    assert main is not None
    threading.Timer(0.3, signal.pthread_kill, (main, signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        call_apart(PLENTY, time.sleep, 30.0)
    assert call_apart(PLENTY, int, "3") == 3


def ask_in_a_fork(answers: multiprocessing.Queue[int]) -> None:
    answers.put(call_apart(PLENTY, os.getpid))


def test_a_forked_process_asks_one_of_its_own() -> None:
    before = call_apart(PLENTY, os.getpid)
    forking = multiprocessing.get_context("fork")
    answers: multiprocessing.Queue[int] = forking.Queue()
    child = forking.Process(target=ask_in_a_fork, args=(answers,))
    child.start()
    assert answers.get(timeout=60) != before
    child.join(60)
    assert call_apart(PLENTY, os.getpid) == before


def test_no_process_is_left_when_the_one_that_asks_is_killed(tmp_path: Path) -> None:
    told = tmp_path / "pid"
    done = subprocess.run(
        [sys.executable, "-c", TELL_AND_WAIT.format(closed=False), str(told)], check=False
    )
    assert done.returncode == -signal.SIGKILL
    until = time.monotonic() + 20
    while lives(int(told.read_text())) and time.monotonic() < until:
        time.sleep(0.05)
    assert not lives(int(told.read_text()))


def test_it_works_where_standard_input_and_output_are_closed(tmp_path: Path) -> None:
    told = tmp_path / "pid"
    subprocess.run(
        [sys.executable, "-c", TELL_AND_WAIT.format(closed=True), str(told)], check=False
    )
    assert int(told.read_text()) > 0


def test_what_a_call_prints_does_not_get_into_the_answer() -> None:
    assert call_apart(PLENTY, os.system, "echo noise") == 0


def test_a_process_that_does_not_start_is_no_fault_of_the_file(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    apart.POOL.close()
    monkeypatch.setattr(apart, "START", "raise SystemExit(3)")
    with pytest.raises(SemSfmError, match=r"does not start .exit code 3.: run `semsfm doctor`"):
        call_apart(PLENTY, os.getpid)
