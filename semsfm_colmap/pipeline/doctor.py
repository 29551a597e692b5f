"""Whether an installation is complete: versions, libraries that do not load, memory, disk.

Each library is imported in a process of its own: one that lacks a shared object, or crashes, is an
answer and not the end. Nothing here needs a GPU.
"""

from __future__ import annotations

import os
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, files, requires, version
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from semsfm_colmap.errors import InputError
from semsfm_colmap.io.extras import EXTRAS, PURPOSES, Extra
from semsfm_colmap.version import __version__

if TYPE_CHECKING:
    from packaging.markers import Marker

State = Literal["good", "weak", "bad", "absent"]
"""weak: it works, slowly or for small series; absent: an extra that was not asked for."""
MIN_MEMORY_GB = 4.0
"""48 images of 1024 x 768 px take 2.5 GB; below this, larger series swap."""
MIN_DISK_GB = 2.0
"""A project takes some 20 times its images: depth maps, database, meshes."""
IMPORT_SECONDS = 120
DISTRIBUTION = "semsfm-colmap"
MODULE_OF = {
    "open3d-cpu": "open3d",
    "opencv-python-headless": "cv2",
    "pillow": "PIL",
    "scikit-image": "skimage",
    "sdfio": "sdfio",
    "tomli-w": "tomli_w",
}
"""Modules whose distributions are called otherwise."""
PARTS = {"numba": ("numba.np.ufunc.omppool",)} if sys.platform == "linux" else {}
"""Modules that a library loads only later: without OpenMP's threads numba takes some of its own,
which end the process when two of ours ask for them at a time."""
PACKAGE_OF = {
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libgomp.so.1": "libgomp1",
    "libgomp.so.1.0.0": "libgomp1",
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libX11.so.6": "libx11-6",
    "libudev.so.1": "libudev1",
    "libidn2.so.0": "libidn2-0",
    "libstdc++.so.6": "libstdc++6",
}
"""Shared objects that the wheels link against, and the packages that have them: as Debian 12 calls
them, where it was tried."""
SHARED_OBJECT = re.compile(r"(lib[\w.+-]+?\.so[.\d]*)")


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One thing that was looked at."""

    name: str
    state: State
    found: str
    cure: str = ""
    """what to type, or to do; empty where nothing is wrong"""


@dataclass(frozen=True, kw_only=True)
class Examination:
    """All findings."""

    findings: tuple[Finding, ...]

    @property
    def is_content(self) -> bool:
        """True where nothing is missing."""
        return all(finding.state != "bad" for finding in self.findings)

    def as_json(self) -> dict[str, Any]:
        """Plain values."""
        return {"content": self.is_content, "findings": [asdict(f) for f in self.findings]}


def examine(path: Path) -> Examination:
    """Look at this installation.

    Parameters
    ----------
    path : where projects will lie, for the space on its disk

    """
    names = libraries()
    absent = [extra for extra, main in EXTRAS.items() if find_spec(main) is None]
    for extra in EXTRAS.keys() - absent:
        names += libraries(extra)
    with ThreadPoolExecutor(max(os.cpu_count() or 1, 2)) as pool:
        loaded = list(pool.map(look_at_library, names))
    loaded += [_absent(extra) for extra in absent]
    return Examination(
        findings=(_python(), *loaded, _memory(), _threads(), _disk(path), _gpu(), _colmap())
    )


def _absent(extra: Extra) -> Finding:
    cure = f'for {PURPOSES[extra]}: {_pip()} install "{DISTRIBUTION}[{extra}]"'
    return Finding(name=f"[{extra}]", state="absent", found="not asked for", cure=cure)


def libraries(extra: str = "") -> tuple[str, ...]:
    """Distributions that this program needs here, as its own metadata say.

    Parameters
    ----------
    extra : those that it adds; default: what every installation has

    """
    from packaging.requirements import Requirement

    try:
        needed = [Requirement(text) for text in requires(DISTRIBUTION) or []]
    except PackageNotFoundError:
        needed = []
    always = {r.name for r in needed if _holds(r.marker, "")}
    named = {r.name for r in needed if _holds(r.marker, extra)}
    asked = named - always if extra else always
    # an extra of an extra is there several times
    return tuple(dict.fromkeys(r.name for r in needed if r.name in asked))


def _holds(marker: Marker | None, extra: str) -> bool:
    return marker is None or marker.evaluate({"extra": extra})


def look_at_library(name: str, run: Callable[..., Any] = subprocess.run) -> Finding:
    """Import one library in a process of its own."""
    modules = (MODULE_OF.get(name, name.replace("-", "_")), *PARTS.get(name, ()))
    try:
        number = version(name)
    except PackageNotFoundError:
        return Finding(
            name=name, state="bad", found="not installed", cure=f"{_pip()} install {name}"
        )
    try:
        done = run(
            [sys.executable, "-c", f"import {', '.join(modules)}"],
            capture_output=True,
            text=True,
            timeout=IMPORT_SECONDS,
        )
    except subprocess.TimeoutExpired:
        found = f"{number}, does not load within {IMPORT_SECONDS} s"
        return Finding(name=name, state="bad", found=found, cure="try again on an idle machine")
    if done.returncode == 0:
        return Finding(name=name, state="good", found=number)
    said = (done.stderr or "").strip().splitlines()
    reason = said[-1] if said else f"ended with exit code {done.returncode}"
    return Finding(
        name=name,
        state="bad",
        found=f"{number}, does not load: {reason}",
        cure=cure_of(reason, missing_objects(name, run))
        or f"{_pip()} install --force-reinstall {name}",
    )


def missing_objects(name: str, run: Callable[..., Any] = subprocess.run) -> list[str]:
    """Shared objects that the system does not have for a distribution, as ldd says.

    An import names only the first one that is missing.
    """
    own = [str(file.locate()) for file in files(name) or () if ".so" in file.name]
    if not own or shutil.which("ldd") is None:
        return []
    done = run(["ldd", *own], capture_output=True, text=True, timeout=IMPORT_SECONDS)
    bundled = {Path(file).name for file in own}
    lost = re.findall(r"^\s*(\S+) => not found", done.stdout or "", flags=re.MULTILINE)
    return [one for one in dict.fromkeys(lost) if one not in bundled]


def cure_of(reason: str, lost: Sequence[str] = ()) -> str:
    """What to type for a library that lacks shared objects; empty where it lacks none.

    Parameters
    ----------
    reason : the error of the import, which names the first one
    lost : all that are known to be missing

    """
    first = SHARED_OBJECT.search(reason)
    if first is None or "cannot open shared object" not in reason:
        return ""
    if first.group(1) not in PACKAGE_OF:
        return f"apt-get install apt-file && apt-file update && apt-file search {first.group(1)}"
    # others that nobody knows may be of parts that are not used: open3d names torch's
    packages = [PACKAGE_OF[one] for one in (first.group(1), *lost) if one in PACKAGE_OF]
    sudo = "" if hasattr(os, "geteuid") and os.geteuid() == 0 else "sudo "
    return f"{sudo}apt-get install {' '.join(dict.fromkeys(packages))}"


def _pip() -> str:
    return f"{sys.executable} -m pip"


def _python() -> Finding:
    found = f"{platform.python_version()}, semsfm {__version__}"
    return Finding(name="python", state="good", found=found)


def _memory() -> Finding:
    gb = memory_gb()
    if gb is None:
        return Finding(name="memory", state="good", found="not known on this system")
    few = gb < MIN_MEMORY_GB
    return Finding(
        name="memory",
        state="weak" if few else "good",
        found=f"{gb:.1f} GB",
        cure="--quality low, or fewer images at a time" if few else "",
    )


def memory_gb() -> float | None:
    """Memory of the machine, or what a container may take of it."""
    try:
        total = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return None
    for file in ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"):
        try:
            text = Path(file).read_text(encoding="ascii").strip()
        except OSError:
            continue
        if text.isdigit():
            total = min(total, int(text))
    return total / 2**30


def _threads() -> Finding:
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return Finding(name="threads", state="good", found=str(count))


def _disk(path: Path) -> Finding:
    if not path.is_dir():
        raise InputError(f"{path} is no folder: give the one in which projects will lie")
    gb = shutil.disk_usage(path).free / 2**30
    writable = os.access(path, os.W_OK)
    cure = "" if writable else "give a folder that can be written as --output_path"
    if gb < MIN_DISK_GB:
        cure = cure or "make room, or give an --output_path on another disk"
    state: State = "bad" if not writable else "weak" if gb < MIN_DISK_GB else "good"
    found = f"{gb:.1f} GB free in {path.resolve()}" + ("" if writable else ", not writable")
    return Finding(name="disk", state=state, found=found, cure=cure)


def _gpu() -> Finding:
    return Finding(name="gpu", state="good", found="none is needed")


def _colmap() -> Finding:
    """COLMAP's own program: not needed, but what many want to carry on with."""
    where = shutil.which("colmap")
    found = where or "not there, and not needed: pycolmap is used"
    return Finding(name="colmap", state="good", found=found)


def system_packages(findings: Iterable[Finding]) -> list[str]:
    """Debian's packages that the findings ask for, each once."""
    asked = [
        f.cure.split("apt-get install ")[1] for f in findings if "apt-get install lib" in f.cure
    ]
    return list(dict.fromkeys(name for names in asked for name in names.split()))


def lines_of(findings: Sequence[Finding]) -> list[str]:
    """A line for each finding, and what to do about it below."""
    mark = {"good": "ok", "weak": "weak", "bad": "MISSING", "absent": "absent"}
    width = max(len(finding.name) for finding in findings)
    lines = []
    for f in findings:
        lines.append(f"{mark[f.state]:<8}{f.name:<{width}}  {f.found}")
        if f.cure:
            lines.append(f"{'':<{10 + width}}-> {f.cure}")
    return lines
