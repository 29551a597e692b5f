"""Run by `test_other_systems.py` in a process of its own: the package where POSIX is not.

What other libraries take from the system is loaded first; then the modules and functions that
Windows lacks are taken away, folders cannot be opened, nothing that is open for reading alone is
brought to the disk, what is open cannot be removed, and every module of the package is imported.
"""

from __future__ import annotations

import errno
import importlib
import importlib.util
import json
import os
import pkgutil
import shutil
import signal
import sys
from importlib.metadata import packages_distributions, requires
from pathlib import Path
from typing import Any

MODULES = ("fcntl", "resource", "pwd", "grp", "termios", "tty", "pty", "syslog", "readline")
OF_OS = (
    "O_CLOEXEC O_DIRECTORY O_NOFOLLOW chown chroot confstr fchdir fchmod fchown fork "
    "forkpty fstatvfs getegid geteuid getgid getgroups getloadavg getpgid getpriority getuid "
    "killpg lchown lockf mkfifo mknod nice openpty pathconf pread pwrite sched_getaffinity "
    "sched_setaffinity sched_yield setegid seteuid setgid setpgid setsid setuid statvfs sync "
    "sysconf uname wait wait3 wait4 waitid"
)
OF_SIGNAL = "SIGALRM SIGBUS SIGCHLD SIGHUP SIGKILL SIGPIPE SIGQUIT SIGTSTP SIGUSR1 SIGUSR2 alarm"


def load_other_libraries() -> None:
    """Import what the package depends on, the optional parts too, as far as it is there."""
    from packaging.requirements import Requirement

    modules: dict[str, list[str]] = {}
    for module, names in packages_distributions().items():
        for name in names:
            modules.setdefault(name.lower().replace("_", "-"), []).append(module)
    for text in requires("semsfm-colmap") or ():
        needed = Requirement(text)
        if needed.marker is None or needed.marker.evaluate({"extra": ""}):
            for module in modules.get(needed.name.lower(), ()):
                if importlib.util.find_spec(module) is not None and module != "open3d":
                    importlib.import_module(module)
    for module in ("distributed", "subprocess", "tempfile", "multiprocessing", "webbrowser"):
        if importlib.util.find_spec(module) is not None:
            importlib.import_module(module)


def take_posix_away() -> None:
    """Leave of the system what Windows has, as far as Python shows it."""
    free = shutil.disk_usage("/")
    shutil.disk_usage = lambda path: free  # as Windows has it without statvfs
    shutil._use_fd_functions = False
    for module in MODULES:
        sys.modules[module] = None  # type: ignore[assignment]
    for name in OF_OS.split():
        if hasattr(os, name):
            delattr(os, name)
    for name in OF_SIGNAL.split():
        if hasattr(signal, name):
            delattr(signal, name)
    del errno.EDQUOT
    sys.platform = "win32"
    for name in ("symlink", "link", "readlink", "kill"):
        setattr(os, name, refusing(name))
    open_file, sync_file, unlink = os.open, os.fsync, os.unlink

    def open_no_folder(path: Any, flags: int, *rest: Any, **named: Any) -> int:
        if os.path.isdir(path):
            raise PermissionError(errno.EACCES, "a folder is not opened", path)
        return open_file(path, flags, *rest, **named)

    def sync_written(handle: int) -> None:
        flags = Path(f"/proc/self/fdinfo/{handle}").read_text().split("flags:")[1].split()[0]
        if int(flags, 8) & (os.O_WRONLY | os.O_RDWR) == 0:
            raise OSError(errno.EBADF, "open for reading alone")
        sync_file(handle)

    def unlink_closed(path: Any, **named: Any) -> None:
        held = Path(f"/proc/{os.getpid()}/fd")
        probed = Path(os.fsdecode(path)).name.startswith(".filelock-probe")  # of its own for POSIX
        if not (named or probed) and any(
            os.path.samefile(f, path) for f in held.iterdir() if f.exists()
        ):
            raise PermissionError(errno.EACCES, "is open", path)
        unlink(path, **named)

    os.open, os.fsync = open_no_folder, sync_written
    os.unlink = os.remove = unlink_closed


def refusing(name: str) -> Any:
    def refuse(*arguments: Any, **named: Any) -> None:
        raise AssertionError(f"os.{name}{arguments} was called")

    return refuse


def import_all() -> list[str]:
    import semsfm_colmap

    found = pkgutil.walk_packages(semsfm_colmap.__path__, "semsfm_colmap.")
    names = [module.name for module in found if not module.name.endswith("__main__")]
    for name in names:
        importlib.import_module(name)
    return names


def use_the_disk(folder: Path) -> dict[str, Any]:
    """What the system is asked: locks, files aside, temporary folders, leftovers, space, memory."""
    from semsfm_colmap.errors import UsageError
    from semsfm_colmap.io.atomic import folder_aside, write_json, write_text
    from semsfm_colmap.io.disk import require_space, to_disk
    from semsfm_colmap.io.interrupt import handle_termination, signals_held
    from semsfm_colmap.io.temporary import remove_leftovers, temporary_folder
    from semsfm_colmap.pipeline.doctor import memory_gb
    from semsfm_colmap.pipeline.project import Project, locked
    from semsfm_colmap.pipeline.record import RunRecord, peak_memory_mb

    handle_termination()
    project = Project(folder / "project")
    said = {}
    with locked(project), signals_held():
        try:
            with locked(project):
                said["second"] = "was let in"
        except UsageError as error:
            said["second"] = str(error)
        write_text("one", project.path / "a.txt")
        write_text("two", project.path / "a.txt")
        write_json({"a": 1}, project.path / "shared.json", shared=True)
        for content in ("old", "new"):
            with folder_aside(project.path / "sparse") as aside:
                (aside / "points3D.bin").write_text(content)
        with temporary_folder(project.path) as held:
            (held / "x").write_text("")
            left = project.path / ".view.html.1.part"
            left.write_text("half")
            remove_leftovers(project.path)
            said["in_use"] = (held / "x").exists()
            said["being_written"] = left.exists()
            os.utime(left, (0, 0))
            remove_leftovers(project.path)
            said["left"] = left.exists()
        said["held"] = held.exists()
        require_space(project.path / "a.txt", 1)
        to_disk(project.path)
        RunRecord(path=project.record).write()
    with locked(Project(folder / "nothing")):
        pass
    said["nothing"] = (folder / "nothing").exists()
    said["content"] = sorted(p.name for p in project.path.rglob("*"))
    said["text"] = (project.path / "a.txt").read_text()
    said["memory"] = [memory_gb(), peak_memory_mb()]
    return said


if __name__ == "__main__":
    load_other_libraries()
    take_posix_away()
    names = import_all()
    print(json.dumps({"modules": names, **use_the_disk(Path(sys.argv[1]))}))
