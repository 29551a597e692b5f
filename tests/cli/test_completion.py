"""Shell completion: what the scripts say, and what bash makes of them."""

import shutil
import subprocess

import pytest

from semsfm_colmap.cli.commands import COMMANDS
from semsfm_colmap.cli.completion import bash, fish, flags_of_commands, spellings, zsh
from semsfm_colmap.cli.main import main


@pytest.fixture(scope="module")
def commands():
    return flags_of_commands()


def completed(script, *words, shell="bash"):
    """What the shell offers for the last of the words."""
    code = (
        'source "$1"; shift; COMP_WORDS=("$@"); COMP_CWORD=$(($#-1)); _semsfm; '
        'printf "%s\\n" "${COMPREPLY[@]}"'
    )
    done = subprocess.run(
        [shell, "-c", code, shell, str(script), *words], capture_output=True, text=True, check=True
    )
    return set(done.stdout.split())


@pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash")
def test_bash_completes_commands_options_values_and_files(commands, tmp_path):
    script = tmp_path / "semsfm.bash"
    script.write_text(bash(commands))
    assert completed(script, "semsfm", "re") == {"reconstruct", "report"}
    assert {c.name for c in COMMANDS} <= completed(script, "semsfm", "")
    assert completed(script, "semsfm", "map", "--refinement.dep") == {"--refinement.depth_sign"}
    assert completed(script, "semsfm", "map", "--depth_sign", "") == {"auto", "as_is", "reversed"}
    assert completed(script, "semsfm", "map", "--quality", "l") == {"low"}
    assert "--guided.no_enabled" in completed(script, "semsfm", "map", "p", "--guided.no")
    assert completed(script, "semsfm", "completion", "z") == {"zsh"}
    (tmp_path / "images").mkdir()
    assert completed(script, "semsfm", "inspect", f"{tmp_path}/im") == {f"{tmp_path}/images"}


def test_every_spelling_of_every_flag_is_in_all_scripts(commands, capsys):
    scripts = [bash(commands), zsh(commands), fish(commands)]
    for name, flags in commands.items():
        for one in spellings(flags):
            assert all(one.lstrip("-") in script for script in scripts), (name, one)
    assert main(["completion", "bash"]) == 0
    assert capsys.readouterr().out.strip() == scripts[0]


def test_an_apostrophe_in_the_words_does_not_end_fishs_quotes(commands):
    for line in fish(commands).splitlines():
        bare = line.replace("\\\\", "").replace("\\'", "")
        assert bare.count("'") % 2 == 0, line
