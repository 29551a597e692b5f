import json
import shutil
import signal
import subprocess
import sys
import threading
from contextlib import contextmanager
from dataclasses import replace
from http.client import HTTPConnection
from urllib.parse import urlsplit

import numpy as np
import pytest

import semsfm_colmap
from semsfm_colmap.errors import UsageError
from semsfm_colmap.io.layout import LOCK_FILE
from semsfm_colmap.io.ply import read_ply_mesh, write_ply
from semsfm_colmap.pipeline import view as view_module
from semsfm_colmap.pipeline.view import make_server, view
from semsfm_colmap.report.viewer.packing import unpack


@contextmanager
def served(path):
    """A server that answers, and a function that asks it: (status, headers, body)."""
    server = make_server(path)
    thread = threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True)
    thread.start()
    port, base = server.server_port, urlsplit(server.address).path

    def ask(place, *, host=None, root=base, method="GET"):
        connection = HTTPConnection("127.0.0.1", port, timeout=60)
        connection.putrequest(method, root + place, skip_host=True)
        connection.putheader("Host", f"127.0.0.1:{port}" if host is None else host)
        connection.endheaders()
        answer = connection.getresponse()
        found = answer.status, dict(answer.getheaders()), answer.read()
        connection.close()
        return found

    try:
        yield server, ask
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


@pytest.fixture(scope="module")
def project(small_project, tmp_path_factory):
    path = tmp_path_factory.mktemp("viewed") / "p"
    shutil.copytree(small_project, path)
    return path


@pytest.fixture(scope="module")
def asked(project):
    with served(project) as (server, ask):
        yield server, ask


def test_the_server_listens_to_this_machine_alone(asked):
    server, _ = asked
    assert server.server_address[0] == "127.0.0.1"
    assert len(server.token) >= 32


@pytest.mark.parametrize("place", ["", "state", "scene.bin", "measure?vertices=0,1"])
def test_without_its_token_an_address_is_refused(asked, place):
    server, ask = asked
    wrong = ["/", "/x/", f"/{server.token[:-1]}/", f"/{server.token}x/", f"//{server.token}x/"]
    for root in wrong:
        status, _, body = ask(place, root=root)
        assert status == 403, root
        assert server.token.encode() not in body


def test_another_host_is_refused_though_it_has_the_token(asked):
    server, ask = asked
    port = server.server_port
    for host in ("evil.example", f"evil.example:{port}", "127.0.0.1", f"127.0.0.1:{port + 1}", ""):
        assert ask("state", host=host)[0] == 403, host
    assert ask("state", host=f"localhost:{port}")[0] == 200


@pytest.mark.parametrize(
    "place",
    ["../../etc/passwd", "..%2f..%2fetc%2fpasswd", "mesh/mesh.ply", "run.json", "//etc/passwd"],
)
def test_files_cannot_be_asked_for(asked, place):
    assert asked[1](place)[0] == 404


def test_nothing_but_reading_is_answered(asked):
    for method in ("POST", "PUT", "DELETE", "OPTIONS"):
        assert asked[1]("state", method=method)[0] == 501


def test_the_page_asks_its_own_server_alone(asked):
    status, headers, body = asked[1]("")
    assert status == 200
    assert "connect-src 'self'" in headers["Content-Security-Policy"]
    assert headers["Referrer-Policy"] == "no-referrer"
    assert headers["Cache-Control"] == "no-store"
    assert b'data-mode="live"' in body
    assert b"http://" not in body.split(b"</style>")[0]


def test_the_scene_holds_the_whole_mesh(asked, project):
    _, headers, body = asked[1]("scene.bin")
    header, arrays = unpack(body)
    mesh = read_ply_mesh(project / "mesh" / "mesh.ply")
    np.testing.assert_array_equal(arrays["place.position"], mesh.vertices.astype(np.float32))
    assert {layer["name"] for layer in header["layers"]} >= {"mesh", "cloud", "points"}
    assert headers["X-Stamp"] == json.loads(asked[1]("state")[2])["stamp"]
    assert "views" in header["layers"][0]["values"]


def test_a_length_is_that_of_measure(asked, project):
    status, _, body = asked[1]("measure?vertices=5,900,40")
    assert status == 200
    length, angle = json.loads(body)["values"]
    copy = project.parent / "copy"
    shutil.copytree(project, copy)
    points = ["vertex:5", "vertex:900", "vertex:40"]
    expected = semsfm_colmap.measure(copy, points=points)
    for one, known in zip((length, angle), expected, strict=True):
        assert one["value"] == known.value
        assert one["sigma"] == known.sigma
        assert [u for _, u in one["sources"]] == [source.contribution for source in known.sources]


@pytest.mark.parametrize("place", ["5", "5,99999999", "5,5", "1,2,3,4", "x", ""])
def test_a_wrong_place_is_told_in_a_sentence(asked, place):
    status, _, body = asked[1](f"measure?vertices={place}")
    assert status == 409
    assert len(json.loads(body)["error"]) > 10


def test_images_of_the_model_are_shown_and_no_others(asked):
    status, headers, body = asked[1]("image?number=2")
    assert (status, headers["Content-Type"]) == (200, "image/png")
    assert body.startswith(b"\x89PNG")
    assert asked[1]("image?number=99")[0] == 409
    assert asked[1]("image?number=-1")[0] == 409


def test_nothing_is_written_to_the_project(project, asked):
    before = {p: p.stat().st_mtime_ns for p in project.rglob("*")}
    for place in ("", "state", "scene.bin", "measure?vertices=5,900", "image?number=0"):
        assert asked[1](place)[0] == 200
    assert {p: p.stat().st_mtime_ns for p in project.rglob("*")} == before


def test_what_a_run_leaves_appears_stage_by_stage(small_project, tmp_path):
    path = tmp_path / "p"
    path.mkdir()
    (path / LOCK_FILE).touch()  # what a run leaves first
    with served(path) as (_, ask):

        def layers():
            return [layer["name"] for layer in unpack(ask("scene.bin")[2])[0]["layers"]]

        def stamp():
            return json.loads(ask("state")[2])["stamp"]

        seen = [stamp()]
        status, _, body = ask("scene.bin")
        assert status == 409
        assert "no model yet" in json.loads(body)["error"]
        shutil.copytree(small_project / "sparse", path / "sparse")
        shutil.copy2(small_project / "series.json", path)
        seen.append(stamp())
        assert layers() == ["points"]
        (path / "dense").mkdir()
        shutil.copy2(small_project / "dense" / "fused.ply", path / "dense")
        seen.append(stamp())
        assert layers() == ["cloud", "points"]
        shutil.copytree(small_project / "mesh", path / "mesh")
        seen.append(stamp())
        assert layers()[0] == "mesh"
        assert len(set(seen)) == len(seen)


def test_a_surface_of_another_model_is_left_out_with_the_reason(small_project, tmp_path):
    path = tmp_path / "p"
    shutil.copytree(small_project, path)
    mesh = read_ply_mesh(path / "mesh" / "mesh.ply")
    away = np.ptp(mesh.vertices, axis=0).max()
    write_ply(path / "mesh" / "mesh.ply", replace(mesh, vertices=mesh.vertices + away))
    with served(path) as (_, ask):
        status, headers, body = ask("scene.bin")
        assert status == 200
        assert "another model" in headers["X-Remark"]
        assert "mesh" not in [layer["name"] for layer in unpack(body)[0]["layers"]]
        status, _, body = ask("measure?vertices=5,900")
        assert status == 409
        assert "another model" in json.loads(body)["error"]
        assert ask("image?number=0")[0] == 200


def test_ctrl_c_ends_it_and_frees_the_port(project, monkeypatch):
    said = []

    def interrupted(self, poll_interval):
        raise KeyboardInterrupt

    monkeypatch.setattr(view_module.ViewServer, "serve_forever", interrupted)
    view(project, open_browser=False, say=said.append)
    assert said[0].startswith("http://127.0.0.1:")
    assert said[-1] == "ended"
    with pytest.raises(OSError):
        HTTPConnection("127.0.0.1", urlsplit(said[0].split()[0]).port, timeout=2).connect()


@pytest.mark.slow
def test_an_interrupt_from_outside_ends_the_command_without_a_trace(project):
    command = [sys.executable, "-m", "semsfm_colmap", "view", str(project), "--no_browser"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        assert process.stderr.readline().startswith("http://127.0.0.1:")
        process.send_signal(signal.SIGINT)
        try:
            _, said = process.communicate(timeout=30)
        finally:
            process.kill()
    assert (process.returncode, said) == (0, "ended\n")


def test_a_folder_that_is_not_there_is_told(tmp_path):
    with pytest.raises(UsageError, match="not a folder"):
        make_server(tmp_path / "none")


def test_a_folder_without_a_project_is_told_at_once(tmp_path):
    (tmp_path / "a.tif").touch()
    with pytest.raises(UsageError, match=r"holds no project: give the folder that `semsfm recon"):
        make_server(tmp_path)
