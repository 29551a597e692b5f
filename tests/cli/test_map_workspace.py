"""`semsfm map WORKSPACE` on a folder that COLMAP made."""

import re
import shlex

from semsfm_colmap.cli.main import main
from semsfm_colmap.colmap.database.images import register_images


def test_a_folder_of_colmaps_is_told_what_to_type(tmp_path, capsys):
    folder = tmp_path / "work space"
    (folder / "images").mkdir(parents=True)
    (folder / "sparse" / "0").mkdir(parents=True)
    register_images(folder / "database.db", ["a.png"], [(9, 9)])
    before = sorted(folder.rglob("*"))
    assert main(["map", str(folder)]) == 2
    said = capsys.readouterr().err
    found = re.search("`(.*)`", said)
    assert found, said
    words = shlex.split(found[1])
    assert words[:2] == ["semsfm", "map"]
    assert sorted(folder.rglob("*")) == before
    # what it says is a command that works: it gets as far as the number of images
    assert main(words[1:]) == 1
    assert "three are needed" in capsys.readouterr().err
