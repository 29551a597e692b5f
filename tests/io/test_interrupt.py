"""SIGINT and SIGTERM stop a command alike, and no library takes them for something else."""

import os
import signal
import subprocess
import sys

import pytest

from semsfm_colmap.cli.main import main
from semsfm_colmap.io.interrupt import Terminated, handle_termination, signals_held

STOPPED = "stopped; what was finished is kept, the same command goes on"


def test_a_signal_waits_until_what_must_not_be_cut_off_is_done():
    done = []

    def stopped():
        with signals_held():
            os.kill(os.getpid(), signal.SIGINT)
            done.append(True)

    with pytest.raises(KeyboardInterrupt):
        stopped()
    assert done == [True]


def test_a_library_cannot_keep_a_handler_of_its_own():
    before = signal.getsignal(signal.SIGTERM)
    with signals_held():
        signal.signal(signal.SIGTERM, lambda *_: None)
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)], ids=["INT", "TERM"]
)
def test_both_end_a_command_in_one_sentence(number, code, monkeypatch, capsys):
    before = signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr(
        "semsfm_colmap.cli.doctor.main", lambda _: os.kill(os.getpid(), number), raising=True
    )
    try:
        assert main(["doctor"]) == code
    finally:
        signal.signal(signal.SIGTERM, before)
    assert capsys.readouterr().err == f"semsfm doctor: {STOPPED}\n"


@pytest.mark.parametrize("library", ["open3d", "pycolmap"])
def test_no_library_swallows_a_signal_while_it_loads_or_after(library, tmp_path):
    # a package of that name that is stopped while it loads, and says what libraries say then
    fake = tmp_path / library
    fake.mkdir()
    (fake / "__init__.py").write_text(
        "import os, signal\n"
        "try:\n    os.kill(os.getpid(), signal.SIGTERM)\n"
        "except BaseException as error:\n    raise ImportError('cannot import name x') from error\n"
        "signal.signal(signal.SIGTERM, signal.SIG_DFL)\n"
        "class logging:\n    minloglevel = 0\n    class Level:\n        WARNING = 1\n"
    )
    code = (
        "import sys; from semsfm_colmap.io.interrupt import Terminated, handle_termination\n"
        "handle_termination()\n"
        "try:\n"
        "    from semsfm_colmap.io.open3d_library import import_open3d; import_open3d()\n"
        if library == "open3d"
        else "import sys; from semsfm_colmap.io.interrupt import Terminated, handle_termination\n"
        "handle_termination()\n"
        "try:\n    import semsfm_colmap.colmap.library\n"
    ) + "except Terminated:\n    sys.exit(7)\n"
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, "PYTHONPATH": path}, check=False
    )
    assert done.returncode == 7


def test_a_process_that_ignores_termination_goes_on_ignoring():
    before = signal.getsignal(signal.SIGTERM)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        handle_termination()
        assert signal.getsignal(signal.SIGTERM) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGTERM, before)
    assert issubclass(Terminated, KeyboardInterrupt)
