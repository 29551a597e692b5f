import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from semsfm_colmap.cli.commands import COMMANDS
from semsfm_colmap.cli.main import BROKEN_PIPE, main


def run(*arguments, **options):
    return subprocess.run(
        [sys.executable, "-m", "semsfm_colmap", *map(str, arguments)],
        capture_output=True,
        text=True,
        **options,
    )


def test_help_names_every_command_and_loads_nothing_heavy():
    done = run("--help")
    assert done.returncode == 0
    assert all(command.name in done.stdout for command in COMMANDS)
    code = (
        "import sys, semsfm_colmap.cli.main as m; m.main(['--help']);"
        "print([n for n in ('numpy', 'scipy', 'numba', 'open3d', 'cv2', 'pycolmap', 'matplotlib')"
        " if n in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip().endswith("[]")


@pytest.mark.parametrize("command", ["inspect", "match", "report", "sh\x9bow"])
def test_a_name_with_escape_sequences_is_told_and_not_obeyed(command, tmp_path, capsys):
    assert main([command, str(tmp_path / "no\x1b[31m\nsuch\u202e")]) == 2
    said = capsys.readouterr().err
    assert said.rstrip("\n").isprintable()
    assert "\\x" in said


@pytest.mark.parametrize("arguments", [["match", "--help"], ["--help"]])
def test_a_reader_that_has_gone_ends_the_output_without_a_word(arguments):
    command = [sys.executable, "-m", "semsfm_colmap.cli.main", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.close()
        said = process.stderr.read()
    assert said == b""
    assert process.returncode == BROKEN_PIPE


@pytest.mark.parametrize("command", [command.name for command in COMMANDS])
def test_every_command_has_help_with_colmaps_spelling(command, capsys):
    with pytest.raises(SystemExit) as stop:
        main([command, "--help"])
    assert stop.value.code == 0
    text = capsys.readouterr().out
    flags = re.findall(r"--[a-z][a-z0-9_.-]*", text)
    assert not [f for f in flags if "-" in f[2:] and f != "--help-all"]


def test_unknown_commands_and_flags_are_usage_errors(capsys):
    assert main(["reconstrct"]) == 2
    assert "did you mean reconstruct" in capsys.readouterr().err
    with pytest.raises(SystemExit) as stop:
        main(["reconstruct", "x", "--output_path", "y", "--matchin.overlap", "3"])
    assert stop.value.code == 2
    assert main([]) == 2


def noise_image(seed):
    return np.random.default_rng(seed).integers(0, 255, (200, 300)).astype(np.uint8)


def folder_empty(path: Path):
    path.mkdir()


def folder_one(path: Path):
    path.mkdir()
    cv2.imwrite(str(path / "a.png"), noise_image(0))


def folder_two(path: Path):
    folder_one(path)
    cv2.imwrite(str(path / "b.png"), noise_image(1))


def folder_text_as_tif(path: Path):
    folder_one(path)
    (path / "b.tif").write_text("not an image")


def folder_without_overlap(path: Path):
    path.mkdir()
    for k in range(5):
        cv2.imwrite(str(path / f"{k}.png"), noise_image(k))


def folder_of_sizes_without_overlap(path: Path):
    path.mkdir()
    for k in range(4):
        cv2.imwrite(str(path / f"{k}.png"), noise_image(k)[: 150 + 10 * k])


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (folder_empty, "no images"),
        (folder_one, "three"),
        (folder_two, "three"),
        (folder_text_as_tif, "b.tif"),
        (folder_without_overlap, "overlap"),
        (folder_of_sizes_without_overlap, "overlap"),
    ],
)
def test_images_that_do_not_allow_it_give_one_sentence_and_exit_1(make, word, tmp_path, capsys):
    make(tmp_path / "images")
    code = main(["reconstruct", str(tmp_path / "images"), "--output_path", str(tmp_path / "out")])
    err = capsys.readouterr().err
    assert code == 1
    assert word in err
    assert "Traceback" not in err
    last = err.strip().splitlines()[-1]
    assert last.startswith("semsfm reconstruct: ")


def test_a_missing_folder_and_a_file_as_output_are_usage_errors(tmp_path, capsys):
    assert main(["reconstruct", str(tmp_path / "no"), "--output_path", str(tmp_path / "o")]) == 2
    folder_without_overlap(tmp_path / "images")
    (tmp_path / "file").write_text("x")
    assert (
        main(["reconstruct", str(tmp_path / "images"), "--output_path", str(tmp_path / "file")])
        == 2
    )
    assert (tmp_path / "file").read_text() == "x"
    assert "is a file" in capsys.readouterr().err


def test_an_output_that_cannot_be_written_is_a_usage_error(tmp_path, capsys):
    folder_without_overlap(tmp_path / "images")
    # even root cannot create a folder there
    target = "/proc/semsfm" if os.path.isdir("/proc") else "/dev/null/semsfm"
    assert main(["reconstruct", str(tmp_path / "images"), "--output_path", target]) == 2
    assert "cannot be written" in capsys.readouterr().err


def test_a_configuration_with_an_unknown_key_is_refused_with_a_suggestion(tmp_path, capsys):
    folder_without_overlap(tmp_path / "images")
    (tmp_path / "c.toml").write_text("[matching]\noverlapp = 3\n")
    code = main(
        [
            "reconstruct",
            str(tmp_path / "images"),
            "--output_path",
            str(tmp_path / "o"),
            "--config_path",
            str(tmp_path / "c.toml"),
        ]
    )
    assert code == 2
    assert "did you mean matching.overlap" in capsys.readouterr().err
    assert not (tmp_path / "o").exists()


def test_the_version_is_that_of_the_package(capsys):
    from semsfm_colmap import __version__

    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"semsfm {__version__}\n"


@pytest.mark.parametrize("stream", ["1", "2", "1 2"])
def test_a_command_runs_without_a_terminal(tmp_path, stream):
    closed = " ".join(f"{number}>&-" for number in stream.split())
    command = f"{shlex.quote(sys.executable)} -m semsfm_colmap.cli.main plan --help {closed}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_who_stops_reading_the_messages_gets_no_traceback(tmp_path):
    (tmp_path / "images").mkdir()
    command = (
        f"{shlex.quote(sys.executable)} -c 'import time; time.sleep(1); "
        'from semsfm_colmap.cli.main import main; import sys; sys.exit(main(["inspect", "."]))\''
        " 2>&1 | true; echo ${PIPESTATUS[0]}"
    )
    done = subprocess.run(
        ["bash", "-c", command], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.stdout, done.stderr) == ("141\n", "")
