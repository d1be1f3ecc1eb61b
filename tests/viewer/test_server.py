"""The viewer's server and files, without a browser."""

from __future__ import annotations

import base64
import contextlib
import hashlib
import http.client
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import zlib
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from support import viewed
from support.manual import block

import ifrdem
from ifrdem.cli.main import main
from ifrdem.errors import InputError
from ifrdem.study.results import Results
from ifrdem.study.task import Variable
from ifrdem.trajectory.reader import Trajectory
from ifrdem.viewer import content, page
from ifrdem.viewer.content import Content
from ifrdem.viewer.points import StudyPoints
from ifrdem.viewer.server import Server


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return viewed.write(tmp_path / "run.h5")


@pytest.fixture
def server(path: Path) -> Iterator[Server]:
    with Server(Content(Trajectory(path))) as found:
        thread = threading.Thread(target=found.serve_forever, args=(0.01,))
        thread.start()
        yield found
        found.shutdown()
        thread.join()


def ask(
    server: Server, place: str, *, method: str = "GET", host: str | None = None, token: str | None = None
):
    """Status, headers and body of an answer; place is what follows the token."""
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=20)
    headers = {} if host is None else {"Host": host}
    connection.request(method, f"/{server.token if token is None else token}/{place}", headers=headers)
    answer = connection.getresponse()
    found = answer.status, dict(answer.getheaders()), answer.read()
    connection.close()
    return found


def unpack(data: bytes) -> tuple[dict, dict[str, np.ndarray]]:
    """Header and arrays, as `page.html` reads them."""
    size = int.from_bytes(data[:4], "little")
    header, at, arrays = json.loads(data[4 : 4 + size]), 4 + size, {}
    for name, kind, length in header["arrays"]:
        arrays[name] = np.frombuffer(data, np.dtype(kind).newbyteorder("<"), length, at)
        at += -(-arrays[name].nbytes // 4) * 4
    return header, arrays


def places(header: dict, arrays: dict[str, np.ndarray]) -> np.ndarray:
    low, high = np.transpose(header["window"])
    return low + arrays["position"].reshape(-1, 2) / 65535.0 * (high - low)


def ids(header: dict, arrays: dict[str, np.ndarray]) -> np.ndarray:
    return np.concatenate([np.arange(header["whole"]), arrays["id"]])


def test_frames_are_those_of_the_trajectory_within_the_quantisation(server, path):
    with Trajectory(path) as trajectory:
        for index, frame in enumerate(trajectory):
            status, headers, body = ask(server, f"frame?frame={index}&colour=spin")
            assert (status, headers["Content-Type"]) == (200, "application/octet-stream")
            header, arrays = unpack(body)
            assert header["time"] == frame.time
            assert header["whole"] == viewed.DISKS
            step = np.ptp(header["window"], axis=1) / 65535.0
            # half a step by rounding
            assert np.all(np.abs(places(header, arrays)[: viewed.DISKS] - frame.position) <= 0.501 * step)
            turn = 2.0 * np.pi / 65536.0
            apart = arrays["angle"][: viewed.DISKS] * turn - frame["angle"]
            assert np.abs((apart + np.pi) % (2.0 * np.pi) - np.pi).max() <= 0.501 * turn
            low, high = header["ranges"]["spin"]
            assert low == -high
            spin = low + arrays["spin"][: viewed.DISKS] / content.LEVELS * (high - low)
            assert (
                np.abs(spin - np.clip(frame.spin, low, high)).max() <= 0.501 * (high - low) / content.LEVELS
            )


def test_disks_that_a_periodic_side_cuts_are_there_on_both_sides(server, path):
    header, arrays = unpack(ask(server, "frame?frame=0")[2])
    with Trajectory(path) as trajectory:
        position = trajectory[0].position
    # in frame 0 the left column and the lowest row reach over the sides, the corner disk over both
    over = np.flatnonzero(position < viewed.RADIUS[:, None])
    images, owner = places(header, arrays)[viewed.DISKS :], arrays["id"]
    assert len(over) == 8 + 5 == len(owner) - 1
    for place, id in zip(images, owner, strict=True):
        shift = (place - position[id]) / (30.0, 20.0)
        np.testing.assert_allclose(shift, np.rint(shift), atol=2e-5)  # a step of 1/65535, twice
        assert np.any(np.rint(shift) != 0.0)


def test_a_window_holds_the_disks_in_it_more_finely(server, path):
    whole, window = (unpack(ask(server, f"frame?frame=1{more}")[2]) for more in ("", "&window=5,12,3,11"))
    with Trajectory(path) as trajectory:
        position = trajectory[1].position
    reach = viewed.RADIUS[:, None]
    inside = ((position + reach >= (5.0, 3.0)) & (position - reach <= (12.0, 11.0))).all(axis=1)
    assert set(ids(*window)) == set(np.flatnonzero(inside))
    assert np.ptp(window[0]["window"], axis=1).max() < 0.5 * np.ptp(whole[0]["window"], axis=1).max()
    np.testing.assert_allclose(places(*window), position[ids(*window)], atol=0.51 * 8.0 / 65535.0)


def test_too_many_disks_are_a_map_of_the_area_that_they_cover(path, monkeypatch):
    monkeypatch.setattr(content, "MOST_DISKS", 10)
    with Trajectory(path) as trajectory:
        header, arrays = Content(trajectory).frame(0)
    assert header["window"] == [[0.0, 30.0], [0.0, 20.0]]
    columns, rows = header["shape"]
    covered = arrays["map"] / content.LEVELS * header["ranges"]["map"][1]
    cell = 600.0 / (columns * rows)
    # each cell is rounded by half a level; cells above the range of the colours are cut, one in a thousand
    assert covered.sum() * cell == pytest.approx(np.pi * np.sum(viewed.RADIUS**2), rel=0.05)


def test_requests_without_the_token_or_for_another_host_are_refused(server):
    assert ask(server, "")[0] == 200
    assert ask(server, "", host=f"localhost:{server.server_port}")[0] == 200
    for more in (
        {"token": ""}, {"token": "x" * len(server.token)}, {"token": server.token[:-1]}, {"token": "%C3%A9"},
        {"host": f"evil.example:{server.server_port}"}, {"host": "127.0.0.1"}, {"host": ""},
        {"method": "POST", "token": "x"}, {"method": "OPTIONS", "host": "evil.example"},
    ):  # fmt: skip
        status, _, body = ask(server, "head", **more)
        assert status == 403, more
        assert server.token.encode() not in body
    assert urlsplit(server.address).hostname == "127.0.0.1"
    assert len(server.token) >= 32


@pytest.mark.parametrize(
    ("place", "status", "reason"),
    [
        ("frame?frame=4", 400, "there are 4 frames"),
        ("frame?frame=x", 400, "frame = x: "),
        ("frame", 400, "frame ="),
        ("frame?frame=0&colour=spinn", 400, "did you mean 'spin'"),
        ("frame?frame=0&window=1,2,3", 400, "window = 1,2,3: must be x0,x1,y0,y1"),
        ("frame?frame=0&window=2,1,0,1", 400, "ascending"),
        ("frame?frame=0&window=0,nan,0,1", 400, "ascending"),
        ("disk?id=40&frame=0", 400, "there are 40 disks"),
        ("head?run=abc", 400, "this is not a study"),
        ("../../etc/passwd", 404, "no such page"),
        ("secret", 404, "no such page"),
    ],
)
def test_bad_requests_are_reported(server, place, status, reason):
    found, _, body = ask(server, place)
    assert found == status
    assert reason in body.decode()


def test_the_page_runs_its_own_script_alone_and_loads_nothing_from_elsewhere(server):
    status, headers, body = ask(server, "")
    text, rules = body.decode(), headers["Content-Security-Policy"]
    assert status == 200
    assert rules.startswith("default-src 'none'; ")
    assert "unsafe" not in rules
    assert "frame-ancestors 'none'" in rules
    for tag in ("script", "style"):
        (own,) = re.findall(rf"<{tag}>(.*?)</{tag}>", text, flags=re.DOTALL)
        assert (
            f"{tag}-src 'sha256-{base64.b64encode(hashlib.sha256(own.encode()).digest()).decode()}'" in rules
        )
    assert re.findall(r"https?://|//\w+\.\w|@import|\ssrc=|\sstyle=|\son\w+=", text) == []


def test_a_page_opens_with_a_colour_that_varies(tmp_path):
    """Spins are all 0 at the start of most cases: every disk was black."""
    disks, box = ifrdem.Disks(4, 1.0, 0.5), ifrdem.Box((9.0, 9.0))
    velocity, position = (
        [[1.0, 0.0], [0.0, 1.0], [-2.0, 0.0], [0.0, 0.0]],
        [[2.0 * i + 1.0, 4.0] for i in range(4)],
    )
    with ifrdem.TrajectoryWriter(tmp_path / "a.h5", disks, box) as file:
        for t, spin in ((0.0, [0.0] * 4), (1.0, [1.0, 2.0, 3.0, 4.0])):
            file.write(ifrdem.State(position, velocity, spin, time=t))
    with Trajectory(tmp_path / "a.h5") as trajectory:
        shown = Content(trajectory)
        assert shown.head()["colour"] == shown.head(0)["colour"] == "speed"
        assert shown.head(1)["colour"] == "spin"
        header, arrays = shown.frame(0, ["direction"])
    assert header["ranges"]["direction"] == [-180.0, 180.0]
    # 0, 90 and 180 degrees; at rest there is no direction
    assert arrays["direction"].tolist() == [
        content.LEVELS // 2,
        round(0.75 * content.LEVELS),
        content.LEVELS,
        content.UNKNOWN,
    ]


def test_head_lists_colours_and_the_reasons_for_missing_ones(server, path, tmp_path):
    head = json.loads(ask(server, "head")[2])
    assert [one["name"] for one in head["colours"]] == [
        "spin", "speed", "direction", "species", "collisions", "since",
    ]  # fmt: skip
    assert head["colour"] == "spin"
    assert head["times"] == [0.0, 0.1, 0.2, 0.3]
    assert head["tracked"] == [viewed.TRACKED]
    assert head["charts"][0]["lines"][0] == {"name": "T", "y": [1.0, 0.5, 0.3333333, 0.25]}
    assert json.loads(ask(server, f"head?frames=4&gas={head['gas']}")[2]) == {"status": ""}
    assert json.loads(ask(server, "head?frames=4")[2])["gas"] == head["gas"]
    viewed.layout_files.write(tmp_path / "bare.h5", fields=("position",))
    with Trajectory(tmp_path / "bare.h5") as trajectory:
        bare = Content(trajectory).head()
    assert [one["name"] for one in bare["colours"]] == ["species"]
    assert set(bare["absent"]) == {"spin", "speed", "direction", "collisions", "since"}
    assert "output.histories" in bare["absent"]["since"]
    assert not bare["marks"]


def test_a_replaced_file_is_detected_despite_equal_numbers_of_frames(server, path, tmp_path):
    head = json.loads(ask(server, "head")[2])
    viewed.layout_files.write(tmp_path / "other.h5", n=3, frames=len(head["times"]))
    (tmp_path / "other.h5").replace(path)
    news = json.loads(ask(server, f"head?frames={len(head['times'])}&gas={head['gas']}")[2])
    assert news["n"] == 3
    assert news["gas"] != head["gas"]


def test_a_request_for_no_address_is_refused_without_a_word_on_the_terminal(server, capfd):
    with socket.create_connection(("127.0.0.1", server.server_port), timeout=10.0) as line:
        line.sendall(b"GET http://[bad/ HTTP/1.1\r\nHost: x\r\n\r\n")
        assert line.recv(100).startswith(b"HTTP/1.1 403 ")
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    "head",
    [
        "Content-Length: {length}",
        "Content-Length: 0\r\nContent-Length: {length}",
        "Transfer-Encoding: chunked",
        "Expect: 100-continue\r\nContent-Length: {length}",
        "no header\r\nContent-Length: {length}",
    ],
)
def test_the_body_of_a_request_is_not_taken_for_the_next_one(server, head):
    """RFC 9112, 6.3: a server that does not read a body to its end closes the connection."""
    hidden = f"GET /{server.token}/head HTTP/1.1\r\nHost: localhost:{server.server_port}\r\n\r\n"
    body = f"{len(hidden):x}\r\n{hidden}\r\n0\r\n\r\n" if "chunked" in head else hidden
    whole = hidden.removesuffix("\r\n") + head.format(length=len(body)) + "\r\n\r\n" + body
    with socket.create_connection(("127.0.0.1", server.server_port), timeout=20) as line:
        line.sendall(whole.encode())
        answer = b""
        with contextlib.suppress(ConnectionResetError):  # what it did not read is thrown away
            while more := line.recv(1 << 16):
                answer += more
    assert answer.count(b"HTTP/1.1 200") == 1
    assert answer.count(b"HTTP/1.1") == (2 if "Expect" in head else 1)  # 100 Continue
    assert b"\r\nConnection: close\r\n" in answer


def test_requests_without_a_body_share_a_connection(server):
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=20)
    for _ in range(2):
        connection.request("GET", f"/{server.token}/head")
        assert connection.getresponse().read()
        assert connection.sock is not None
    connection.close()


def test_history_of_a_disk_is_sent_or_that_it_was_not_tracked(server):
    found = json.loads(ask(server, f"disk?id={viewed.TRACKED}&frame=2")[2])
    assert (found["collisions"], found["kicks"]) == (3, 1)
    assert [row[:2] for row in found["rows"]] == [[0.05, 3.0], [0.12, -3.0], [0.25, 9.0]]
    assert found["rows"][0][3:7] == [1.0, 2.0, -1.0, 2.5]
    assert found["rows"][1][-1] == "sticking"
    other = json.loads(ask(server, "disk?id=8&frame=2")[2])
    assert (other["collisions"], other["rows"]) == (None, [])
    assert other["values"]["position"] == pytest.approx(viewed.state(2).position[8].tolist(), rel=1e-6)


def test_long_histories_are_cut_around_the_frames_time(path):
    with Trajectory(path) as trajectory:
        found = Content(trajectory)
        assert [row[0] for row in found.collisions(viewed.TRACKED, 0.0, 2)["rows"]] == [0.05, 0.12]
        assert [row[0] for row in found.collisions(viewed.TRACKED, 0.3, 2)["rows"]] == [0.12, 0.25]


def test_time_since_the_last_collision_is_that_of_the_history(path):
    with Trajectory(path) as trajectory:
        found = Content(trajectory)
        assert np.isnan(found.since(trajectory[0])).all()
        for index, last in ((1, 0.05), (2, 0.12), (3, 0.25)):
            since = found.since(trajectory[index])
            assert since[viewed.TRACKED] == pytest.approx(trajectory.times[index] - last)
            assert np.isnan(np.delete(since, viewed.TRACKED)).all()


def test_one_file_holds_the_frames_deflated(path, tmp_path):
    out = tmp_path / "sent.html"
    assert main(["view", str(path), "--html", str(out), "--frames", "::2"]) == 0
    text = out.read_text()
    assert "connect-src &#x27;none&#x27;" in text
    assert "frame-ancestors" not in text  # which has no meaning in a file
    blocks = dict(re.findall(r'<script type="text/plain" id="([\w-]+)">(.*?)</script>', text))
    assert json.loads(blocks["head"])["times"] == [0.0, 0.2]
    assert [row[0] for row in json.loads(blocks["histories"])[str(viewed.TRACKED)]["rows"]] == [
        0.05,
        0.12,
        0.25,
    ]
    header, arrays = unpack(zlib.decompress(base64.b64decode(blocks["frame-1"])))
    assert header["index"] == 2
    assert {"spin", "speed", "collisions", "since"} < set(arrays)
    assert arrays["angle"].dtype == np.uint16
    assert main(["view", str(path), "--html", str(out)]) == 2  # it exists
    assert main(["view", str(path), "--html", str(out), "--force"]) == 0


def test_frames_of_one_file_that_change_little_are_smaller_as_differences():
    rng = np.random.default_rng(1)
    before = {
        "position": rng.integers(0, 2**16, 2020, np.uint16),
        "angle": rng.integers(0, 256, 1010, np.uint8),
    }
    step = rng.integers(-40, 40, 2020)
    arrays = {"position": before["position"] + step.astype(np.uint16), "angle": before["angle"]}
    now = page._differences(arrays, before, 1000)  # and ten images
    assert [*now] == ["position", "angle"]  # in the order of the arrays, whatever the seed of hashes
    low, high = now["position"].reshape(2, -1).astype(int)
    whole = low + 256 * high
    np.testing.assert_array_equal((whole[:2000] + 2**15) % 2**16 - 2**15, step[:2000])
    np.testing.assert_array_equal(whole[2000:], arrays["position"][2000:])
    assert not now["angle"][:1000].any()
    fresh = {name: rng.permutation(one) for name, one in arrays.items()}
    assert page._differences(fresh, before, 1000) == {}


def test_the_server_of_a_trajectory_says_that_it_has_no_points(path):
    message = "point: a trajectory is shown here; `ifrdem view --study` shows the points"
    with Server(Content(Trajectory(path))) as server, pytest.raises(InputError, match=message):
        server.answer("point", {"point": "0"})


def test_notebooks_show_the_page_in_a_frame(path):
    shown = ifrdem.view(Trajectory(path), [0, -1])._repr_html_()
    assert shown.startswith('<iframe sandbox="allow-scripts" srcdoc="&lt;!doctype html&gt;')
    assert "frame-1" in shown
    assert "frame-2" not in shown
    assert "frame-3" in ifrdem.view(path)._repr_html_()
    with pytest.raises(InputError, match="there are 4 frames"):
        ifrdem.view(path, [9])
    with pytest.raises(InputError, match=r"frames = \[\]: must be"):
        ifrdem.view(path, [])
    for wrong, message in (
        ({"frames": 3}, "frames = 3: must be a sequence, each an integer"),
        ({"frames": ["a"]}, r"frames\[0\] = 'a': must be an integer"),
        ({"height": "tall"}, "height = 'tall': must be an integer"),
        ({"height": -3}, "height = -3: must be an integer from 1 to 100000"),
    ):
        with pytest.raises(InputError, match=message):
            ifrdem.view(path, **wrong)


def test_the_manuals_example_shows_the_page(path, monkeypatch):
    monkeypatch.chdir(path.parent)
    path.rename("cooling.h5")
    *lines, last = block("view").splitlines()
    found: dict = {}
    exec("\n".join(lines), found)
    assert "<iframe" in eval(last, found)._repr_html_()


def test_one_file_of_too_many_disks_is_refused(path, monkeypatch):
    monkeypatch.setattr(page, "MOST_DISKS", 30)
    with Trajectory(path) as trajectory, pytest.raises(InputError, match="40 disks are too many"):
        page.page(trajectory, [0])


def some_results(folder: Path) -> Path:
    """Results of a study of three points and two seeds; one run has its trajectory."""
    e_n, T = np.array([0.7, 0.8, 0.9]), np.arange(1.0, 13.0).reshape(3, 4)
    runs = np.array([[f"run{p}{s}" for s in range(2)] for p in range(3)], dtype=object)
    variables = {
        "e_n": Variable(("e_n",), e_n), "seed": Variable(("seed",), np.array([1, 2])),
        "collisions_per_disk": Variable(("collisions_per_disk",), np.arange(4.0)),
        "temperature": Variable(
            ("e_n", "seed", "collisions_per_disk"), np.stack([0.9 * T, 1.1 * T], axis=1), "J"
        ),
        "temperature_mean": Variable(("e_n", "collisions_per_disk"), T, "J"),
        "temperature_error": Variable(("e_n", "collisions_per_disk"), 0.1 * T, "J"),
        "run": Variable(("e_n", "seed"), runs), "failure": Variable(("e_n", "seed"), np.full((3, 2), "", object)),
    }  # fmt: skip
    attributes = {"axes": '{"e_n": ["e_n"]}', "keys": '{"e_n": "material[0].e_n"}', "title": "three points"}
    Results(variables, attributes).write(folder / "scan.nc")
    (folder / "scan.runs").mkdir()
    viewed.write(folder / "scan.runs" / "run01.h5")
    return folder / "scan.nc"


def test_points_of_a_study_have_their_curves_and_the_trajectories_that_were_kept(tmp_path):
    path, tan = some_results(tmp_path), np.tan(0.475 * np.pi)
    viewed.write(tmp_path / "elsewhere.h5")
    stored = Results.read(path)
    stored.variables["run"].values[1, 0] = "../elsewhere"
    stored.write(path)
    for place in (path, tmp_path / "scan.runs"):
        with Server(StudyPoints(place)) as server:
            head = json.loads(server.answer("head", {})[1])
            assert head["ends"]["temperature"] == {
                "unit": "J",
                "mean": [4.0, 8.0, 12.0],
                # Student's t of two seeds is 12.706 at 97.5 % (tan(0.475 pi), Cauchy's distribution).
                "error": pytest.approx([0.4 * tan, 0.8 * tan, 1.2 * tan], rel=1e-6),
            }
            assert [one["label"] for one in head["points"]] == ["e_n = 0.7", "e_n = 0.8", "e_n = 0.9"]
            assert [one["runs"] for one in head["points"]] == [["", "run01"], ["", ""], ["", ""]]
            (chart,) = json.loads(server.answer("point", {"point": "1"})[1])["charts"]
            assert chart["lines"][0]["y"] == [5.0, 6.0, 7.0, 8.0]
            assert json.loads(server.answer("head", {"run": "run01", "frames": "-1"})[1])["n"] == viewed.DISKS
            for run in ("run00", "../run", "../elsewhere", ""):
                with pytest.raises(InputError, match="kept no trajectory"):
                    server.answer("frame", {"run": run, "frame": "0"})


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--port", "99999"], "--port 99999: must be an integer from 0 to 65535"),
        (["--frames", "0"], "--frames requires --html"),
        (["--force"], "--force requires --html"),
        (["--study", "--html", "x.html"], "--html: cannot be combined with --study"),
        (["--study"], "run.h5: must be the results of a study, NAME.nc"),
        (["--html", "run.h5"], "is the trajectory itself"),
        (["--html", "new.html", "--frames", "9"], "names none of the 4 frames"),
    ],
)
def test_bad_options_are_reported(path, monkeypatch, capsys, arguments, reason):
    monkeypatch.chdir(path.parent)
    assert main(["view", "run.h5", *arguments]) == 2
    error = capsys.readouterr().err
    assert reason in error
    assert "Traceback" not in error


def test_the_browser_gets_the_token_by_a_private_file(path, monkeypatch, capsys):
    """The arguments of a process are seen by every user of the machine."""
    given: list[tuple[Path, int, str]] = []

    def browser(url: str) -> bool:
        file = Path(urlsplit(url).path)
        given.append((file, file.stat().st_mode & 0o777, file.read_text()))
        return True

    def interrupted(_: Server) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("webbrowser.open", browser)
    monkeypatch.setattr(Server, "serve_forever", interrupted)
    before = os.umask(0)
    try:
        assert main(["view", str(path)]) == 0
    finally:
        os.umask(before)
    ((file, mode, text),) = given
    address = capsys.readouterr().out.split()[-1]
    assert mode == 0o600
    assert f'content="0; url={address}"' in text
    assert urlsplit(address).path.strip("/") not in str(file)
    assert not file.parent.exists()


def test_a_port_that_is_taken_is_reported(server, path, capsys):
    assert main(["view", str(path), "--no-browser", "--port", str(server.server_port)]) == 2
    assert f"--port {server.server_port}: " in capsys.readouterr().err


@pytest.mark.full
def test_ctrl_c_ends_with_status_0(path):
    command = [sys.executable, "-m", "ifrdem", "view", str(path), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "the page is served until Ctrl-C, at\n"
        assert re.fullmatch(r"http://127\.0\.0\.1:\d+/[\w-]{32,}/\n", process.stdout.readline())
        process.send_signal(signal.SIGINT)
        assert process.communicate(timeout=60) == ("", "")
    assert process.returncode == 0
