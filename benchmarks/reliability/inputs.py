"""Bad input, each through a whole `reconstruct`, twice: what is said and how it ends.

A row makes its folder from the images of the series. Wrong is a traceback, another exit code than
expected, a sentence that does not name what is wrong, characters that a terminal would obey,
anything left aside or outside of the project, and a second run that does not say the same.
"""

from __future__ import annotations

import contextlib
import io
import os
import shutil
import traceback
import unicodedata
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import tifffile

from benchmarks.reliability.projects import LOCK, Series, files, fresh
from semsfm_colmap.cli.main import main

IMAGES, PROJECT = "images", "p"
ONE_MORE = "grain_005.tif"


@dataclass(frozen=True, kw_only=True)
class Bad:
    """One kind of bad input."""

    what: str
    make: Callable[[Path], list[str] | None]
    """changes a fresh copy of the images (or what lies beside it); options that go with it"""
    says: str
    """words of the sentence about it; empty where nothing is wrong with it"""
    code: int = 0


def images_of(folder: Path) -> list[Path]:
    """The images in their order."""
    return sorted(folder.glob("*.tif"))


def keep(number: int) -> Callable[[Path], None]:
    """Only the first images."""

    def make(folder: Path) -> None:
        for path in images_of(folder)[number:]:
            path.unlink()

    return make


def add(name: str | bytes, content: bytes | None) -> Callable[[Path], None]:
    """One more file; None: a broken link."""

    def make(folder: Path) -> None:
        path = os.path.join(os.fsencode(folder), os.fsencode(name))
        if content is None:
            os.symlink(b"nowhere", path)
        else:
            with open(path, "wb") as file:
                file.write(content)

    return make


def pixels(
    change: Callable[[np.ndarray], np.ndarray], name: str = ONE_MORE
) -> Callable[[Path], None]:
    """The last image with other pixels and no header, under a name; by default one more."""

    def make(folder: Path) -> None:
        tifffile.imwrite(folder / name, change(tifffile.imread(images_of(folder)[-1])))

    return make


def every(change: Callable[[np.ndarray, int], np.ndarray]) -> Callable[[Path], None]:
    """All images with other pixels and no header."""

    def make(folder: Path) -> None:
        for number, path in enumerate(images_of(folder)):
            tifffile.imwrite(path, change(tifffile.imread(path), number))

    return make


def copied(name: str | bytes) -> Callable[[Path], None]:
    """The last image once more, under a name."""

    def make(folder: Path) -> None:
        shutil.copy(
            os.fsencode(images_of(folder)[-1]), os.fsencode(folder) + b"/" + os.fsencode(name)
        )

    return make


def renamed(name: str | bytes) -> Callable[[Path], None]:
    """The last image under another name."""

    def make(folder: Path) -> None:
        os.rename(
            os.fsencode(images_of(folder)[-1]), os.fsencode(folder) + b"/" + os.fsencode(name)
        )

    return make


def saved_again(suffix: str) -> Callable[[Path], None]:
    """The first image a second time in another format."""

    def make(folder: Path) -> None:
        path = images_of(folder)[0]
        cv2.imwrite(str(folder / f"export{suffix}"), tifffile.imread(path))

    return make


def one_name(folder: Path) -> None:
    """Two images that both become grain_000.png."""
    first, second = images_of(folder)[:2]
    cv2.imwrite(str(folder / "grain_000.jpg"), tifffile.imread(first))
    cv2.imwrite(str(folder / "grain_000.png"), tifffile.imread(second))
    first.unlink()
    second.unlink()


def cut_short(folder: Path) -> None:
    """One image more, without its second half."""
    content = images_of(folder)[-1].read_bytes()
    (folder / ONE_MORE).write_bytes(content[: len(content) // 2])


def as_png(folder: Path) -> None:
    """A PNG called .tif."""
    path = images_of(folder)[-1]
    path.write_bytes(cv2.imencode(".png", tifffile.imread(path))[1].tobytes())


def twice(folder: Path) -> None:
    """One view taken again, with noise of its own."""
    image = tifffile.imread(images_of(folder)[2]).astype(float)
    noise = np.random.default_rng(0).normal(scale=12.0, size=image.shape)
    tifffile.imwrite(folder / "grain_002b.tif", np.clip(image + noise, 0, 255).astype(np.uint8))


def cmyk(folder: Path) -> None:
    """All images as CMYK."""
    for path in images_of(folder):
        black = 255 - tifffile.imread(path)
        inks = np.stack([np.zeros_like(black)] * 3 + [black], axis=-1)
        tifffile.imwrite(path, inks, photometric="separated")


def flat(image: np.ndarray, number: int) -> np.ndarray:
    """A plane: one pattern, foreshortened as a tilt about the y axis does it."""
    rng = np.random.default_rng(0)
    pattern = cv2.GaussianBlur(rng.normal(size=image.shape), (0, 0), 1.5)
    pattern = 128.0 + 40.0 * pattern / pattern.std()
    width = image.shape[1]
    cosine = float(np.cos(np.deg2rad(9.0 * number)))
    move = np.array([[cosine, 0, (1 - cosine) * width / 2], [0, 1, 0]])
    noise = np.random.default_rng(number + 1).normal(scale=3.0, size=image.shape)
    seen = cv2.warpAffine(pattern, move, image.shape[::-1], borderMode=cv2.BORDER_REFLECT)
    return np.asarray(np.clip(seen + noise, 0, 255).astype(np.uint8))


def shrinking(image: np.ndarray, number: int) -> np.ndarray:
    """Each frame 2 % less high than the one before."""
    height = round(image.shape[0] * 0.98**number)
    return np.asarray(cv2.resize(image, (image.shape[1], height), interpolation=cv2.INTER_AREA))


def standing(image: np.ndarray, number: int) -> np.ndarray:
    """A texture that stays in place where the specimen is not."""
    rng = np.random.default_rng(0)
    texture = cv2.GaussianBlur(rng.normal(size=image.shape), (0, 0), 2.0)
    texture = 90.0 + 25.0 * texture / texture.std()
    noise = np.random.default_rng(number).normal(scale=4.0, size=image.shape)
    empty = cv2.GaussianBlur(image.astype(float), (0, 0), 3.0) < 30.0
    return np.asarray(np.clip(np.where(empty, texture + noise, image), 0, 255).astype(np.uint8))


def with_table(text: str | bytes) -> Callable[[Path], list[str]]:
    """A table beside the images."""

    def make(folder: Path) -> list[str]:
        path = folder.parent / "table.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return ["--series_csv", str(path)]

    return make


def with_mask(mask: Callable[[np.ndarray], np.ndarray]) -> Callable[[Path], list[str]]:
    """A mask for the first image."""

    def make(folder: Path) -> list[str]:
        first, place = images_of(folder)[0], folder.parent / "own"
        place.mkdir()
        cv2.imwrite(str(place / f"{first.name}.png"), mask(tifffile.imread(first)))
        return ["--masks_path", str(place)]

    return make


def huge(folder: Path) -> None:
    """A PNG whose header claims 100,000 x 100,000 px."""
    import struct
    import zlib

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    head = struct.pack(">IIBBBBB", 100_000, 100_000, 8, 0, 0, 0, 0)
    data = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(b""))
    (folder / "huge.png").write_bytes(data)


def in_folders(folder: Path) -> None:
    """The last two under one name in folders."""
    for place, path in zip(("a", "b"), images_of(folder)[-2:], strict=True):
        (folder / place).mkdir()
        path.rename(folder / place / "same.tif")


NAME = "grain_000.tif"
ROWS = (
    Bad(what="no such folder", make=shutil.rmtree, says="images", code=2),
    Bad(what="no images", make=keep(0), says="no images", code=1),
    Bad(what="one image", make=keep(1), says="", code=1),
    Bad(what="two images", make=keep(2), says="", code=1),
    Bad(what="table missing", make=lambda f: ["--series_csv", str(f / "no.csv")], says="no.csv",
        code=2),
    Bad(what="table not text", make=with_table(bytes(range(256))), says="table.csv", code=2),
    Bad(what="table with a number that is none", says="table.csv", code=2,
        make=with_table(f"image,tilt_deg\n{NAME},ten\n")),
    Bad(what="table with a line twice", says="table.csv", code=2,
        make=with_table(f"image,tilt_deg\n{NAME},1\n{NAME},2\n")),
    Bad(what="table that names none of the images", says="table.csv", code=1,
        make=with_table("image,tilt_deg\nother.tif,1\n")),
    Bad(what="two files that would get one name", make=one_name, says="grain_000", code=1),
    Bad(what="a flat specimen", make=every(flat), says="flat to within the noise", code=1),
    Bad(what="a file of zero bytes", make=add("empty.tif", b""), says="empty.tif"),
    Bad(what="an image cut short", make=cut_short, says=ONE_MORE),
    Bad(what="text with an image's name", make=add("text.tif", b"none\n" * 99), says="text.tif"),
    Bad(what="a PNG called .tif", make=as_png, says="grain_004.tif"),
    Bad(what="a header of 100,000 x 100,000 px", make=huge, says="huge.png"),
    Bad(what="a frame of a single value", says=ONE_MORE,
        make=pixels(lambda a: np.zeros_like(a))),
    Bad(what="pixels that are nan", says="nan",
        make=pixels(lambda a: np.where(a >= a.max(), np.nan, a).astype(np.float32),
                    "grain_004.tif")),
    Bad(what="a copy as PNG", make=saved_again(".png"), says="export.png"),
    Bad(what="a copy as JPEG", make=saved_again(".jpg"), says="export.jpg"),
    Bad(what="one view taken twice", make=twice, says="shows the view of"),
    Bad(what="an image of noise", says=ONE_MORE,
        make=pixels(lambda a: np.random.default_rng(1).integers(0, 255, a.shape, np.uint8))),
    Bad(what="an image of less than 32 px a side", says=ONE_MORE,
        make=pixels(lambda a: a[:20, :20])),
    Bad(what="each frame 2 % less high", make=every(shrinking), says="size"),
    Bad(what="a background that stays in place", make=every(standing),
        says="; features stand still", code=1),
    Bad(what="CMYK", make=cmyk, says=""),
    Bad(what="equal names in folders", make=in_folders, says=""),
    Bad(what="a link to nothing", make=add("link.tif", None), says="link.tif"),
    Bad(what="a mask of another size", says="mask",
        make=with_mask(lambda a: np.full((9, 9), 255, np.uint8))),
    Bad(what="a mask that leaves nothing", make=with_mask(np.zeros_like), says="mask"),
    Bad(what="table with unknown columns", says="colour",
        make=with_table(f"image,tilt_deg,colour\n{NAME},0,red\n")),
    Bad(what="a name in Greek", make=renamed("κόκκος.tif"), says=""),
    Bad(what="a name that begins with a dash", make=renamed("--help.tif"), says=""),
    Bad(what="a name with spaces", make=renamed("last one.tif"), says="spaces"),
    Bad(what="a name with an escape sequence", make=copied("\x1b]0;x\x07\x1b[2J.tif"), says="x1b"),
    Bad(what="a name with a line break", make=copied("a\nwarning: b.tif"),
        says="left out, rename"),
    Bad(what="a name that turns the writing", make=copied("a\u202efit.tif"), says=""),
    Bad(what="a name that is not UTF-8", make=copied(b"\xff\x9b.tif"), says="left out, rename"),
    Bad(what="a name with markup", says="",
        make=renamed('a"\'><img src=x onerror=alert(1)><!--&.tif')),
)  # fmt: skip


def obeyed(text: str) -> list[str]:
    """Characters that a terminal would obey or that turn its writing."""
    return sorted({repr(c) for c in text if c != "\n" and unicodedata.category(c) in ("Cc", "Cf")})


def run(arguments: list[str]) -> tuple[int, str]:
    """Exit code and all that is said; a traceback where one comes out."""
    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
        try:
            code = main(arguments)
        except BaseException:
            traceback.print_exc(file=said)
            code = -1
    return code, said.getvalue()


def sentence(text: str, words: str) -> str:
    """The line that holds the words, or the last one."""
    lines = [line.removeprefix("warning: ") for line in text.splitlines() if line.strip()]
    named = [line for line in lines if words and words in line]
    return (named or lines or [""])[0 if named else -1]


def feed(series: Series, folder: Path, row: Bad) -> dict[str, object]:
    """One row, twice."""
    place = fresh(folder / "input")
    place.mkdir()
    shutil.copytree(series.images, place / IMAGES)
    options = row.make(place / IMAGES) or []
    before = files(place)
    arguments = ["reconstruct", str(place / IMAGES), "--output_path", str(place / PROJECT)]
    runs = [run([*arguments, *options]) for _ in range(2)]
    code, said = runs[0]
    wrong = [] if code == row.code else [f"exit code {code}"]
    wrong += ["a traceback"] if "Traceback" in said else []
    wrong += [f"a terminal obeys {c}" for c in obeyed(said)]
    wrong += [] if row.says in said else [f"{row.says} is not said"]
    wrong += [] if runs[1][0] == code else [f"exit code {runs[1][0]} of the second run"]
    if code and sentence(runs[1][1], row.says) != sentence(said, row.says):
        wrong.append(f"the second run says: {sentence(runs[1][1], row.says)}")
    new = files(place) - before
    wrong += [f"{name} is left" for name in sorted(new) if is_left(name, code)]
    page = place / PROJECT / "report" / "report.html"
    if page.is_file() and "<img src=x" in page.read_text(encoding="utf-8"):
        wrong.append("markup in the report")
    words = sentence(said, row.says).replace(str(place) + "/", "").replace("|", "\\|")
    return {"what": row.what, "code": code, "said": words if row.says or code else "",
            "wrong": wrong}  # fmt: skip


def is_left(name: str, code: int) -> bool:
    """Whether a new file should not be there."""
    if not name.startswith(f"{PROJECT}/"):
        return True
    hidden = any(part.startswith(".") for part in Path(name).parts)
    return (hidden and Path(name).name != LOCK) or (code == 2 and Path(name).name != LOCK)


def rows(results: list[dict[str, object]]) -> Iterator[tuple[object, ...]]:
    """Of the table: what is wrong, what is said, how it ends."""
    for one in results:
        yield one["what"], one["said"] or "nothing", one["code"]
