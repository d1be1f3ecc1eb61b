"""The viewer's page in a real browser: Chromium without a graphics processor, driven by playwright."""

from __future__ import annotations

import io
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from support import layout_files, viewed
from test_server import some_results

import ifrdem
from ifrdem.cli.main import main

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytestmark = [
    pytest.mark.full,
    pytest.mark.browser,
    pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium on this machine"),
]
SOFTWARE = [
    "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--disable-gpu-compositing", "--disable-gpu-watchdog", "--no-sandbox",
    "--disable-background-timer-throttling", "--disable-renderer-backgrounding",
]  # fmt: skip
PATIENCE = 180.0
"""Seconds until a page that stands still has failed: on a machine that is busy, a start alone takes half a minute."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as driver:
        found = driver.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE, timeout=1000.0 * PATIENCE)
        yield found
        found.close()


@pytest.fixture
def page(browser: Any, serve: Any) -> Iterator[Any]:
    """A window whose console must stay without errors; the server outlives it."""
    context = browser.new_context(viewport={"width": 900, "height": 700}, color_scheme="light")
    context.set_default_timeout(1000.0 * PATIENCE)
    found, wrong = context.new_page(), []
    found.on("console", lambda message: wrong.append(message.text) if message.type == "error" else None)
    found.on("pageerror", lambda error: wrong.append(str(error)))
    found.wrong = wrong
    yield found
    context.close()
    assert wrong == []


@pytest.fixture
def serve() -> Iterator[Any]:
    """Starts `ifrdem view`, behind lines of Python, and returns its address."""
    running = []

    def start(*arguments: object, first: str = "") -> str:
        words = ["--quiet", "view", *map(str, arguments), "--no-browser"]
        code = f"{first}\nfrom ifrdem.cli.main import main\nmain({words!r})"
        command = [sys.executable, "-c", code]
        running.append(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
        return str(running[-1].stdout.readline().strip())

    yield start
    for process in running:
        process.terminate()
        process.communicate()


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return viewed.write(tmp_path_factory.mktemp("view") / "run.h5")


def until(page: Any, condition: str) -> None:
    """Wait for what JavaScript says; the page's policy forbids the browser's own way."""
    end = time.monotonic() + PATIENCE
    while not page.evaluate(condition):
        assert time.monotonic() < end, f"{condition}: {page.evaluate('document.body.innerText')}"
        time.sleep(0.05)


def opened(page: Any, address: str) -> None:
    page.goto(address)
    until(page, "head !== null && frame !== null && !busy && legend.state !== undefined")
    pixels(page)  # the header has its place


def pixels(page: Any) -> np.ndarray:
    """The window, shape (height, width, 3)."""
    page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB")).astype(int)


def spot(page: Any, x: float, y: float) -> tuple[int, int]:
    """Pixel of a place [length]."""
    left, top, px, py = page.evaluate(
        f"(() => {{ const box = stage.getBoundingClientRect(); return [box.left, box.top, toX({x}), toY({y})] }})()"
    )
    return round(left + px), round(top + py)


def choose(page: Any, id: str, value: str) -> None:
    page.select_option(f"#{id}", value)
    until(page, "!busy")


@pytest.mark.parametrize(
    ("width", "height", "way"), [(900, 700, "points"), (1800, 1500, "quads"), (900, 700, "pixels")]
)
def test_disks_are_drawn_where_they_are_in_their_colours(page, serve, path, width, height, way):
    page.set_viewport_size({"width": width, "height": height})
    opened(page, serve(path))
    choose(page, "colour", "species")
    if way == "pixels":
        page.evaluate("paintDisks = paintPixels; gl.clear(gl.COLOR_BUFFER_BIT); ask_paint()")
    else:
        until(page, f"(2 * largest * view.zoom > LARGEST_POINT) === {'true' if way == 'quads' else 'false'}")
    shown, colours = pixels(page), {0: (0, 114, 178), 1: (230, 159, 0)}
    for id in range(8, 32):
        x, y = viewed.state(0).position[id]
        column, row = spot(page, x, y + 0.5 * viewed.RADIUS[id])  # marks point to the right in frame 0
        assert np.abs(shown[row, column] - colours[id % 2]).max() <= 8, id
        column, row = spot(page, x, y + 1.3)  # between the rows
        assert tuple(shown[row, column]) == (255, 255, 255)


def test_a_disk_cut_by_a_side_shows_on_the_other_side_and_nothing_beyond(page, serve, path):
    opened(page, serve(path))
    choose(page, "colour", "species")
    shown = pixels(page)
    x, y = viewed.state(0).position[8]  # radius 0.8, x = 0.3
    assert x < viewed.RADIUS[8]
    for place, inside in ((0.1, True), (29.7, True), (30.2, False), (-0.3, False)):
        column, row = spot(page, place, y + 0.35)
        assert (np.abs(shown[row, column] - (0, 114, 178)).max() <= 8) == inside, place


def test_zoomed_disks_have_marks_that_turn(page, serve, path):
    opened(page, serve(path))
    x, y = viewed.state(2).position[11]
    page.evaluate(f"show(2); Object.assign(view, {{x: {x}, y: {y}, zoom: 120}}); ask_paint()")
    until(page, "!busy && index === 2")
    shown, angle = pixels(page), 0.5 * 2 * 11
    along = spot(page, x + 0.3 * np.cos(angle), y + 0.3 * np.sin(angle))
    against = spot(page, x - 0.3 * np.cos(angle), y - 0.3 * np.sin(angle))
    assert tuple(shown[along[1], along[0]]) == (255, 255, 255)
    assert shown[against[1], against[0]].min() < 120


def test_keys_and_slider_change_the_frame(page, serve, path):
    opened(page, serve(path))
    before = pixels(page)
    for key, frame in (("ArrowRight", 1), ("End", 3), ("ArrowLeft", 2), ("Home", 0)):
        page.keyboard.press(key)
        until(page, f"index === {frame} && frame.index === {frame}")
        assert f"frame {frame} of 3, t = 0" in page.inner_text("#where")
    page.evaluate("$('scrub').value = 3; $('scrub').dispatchEvent(new Event('input'))")
    until(page, "frame.index === 3")
    assert np.abs(pixels(page) - before).sum() > 1e5
    page.keyboard.press("Home")
    page.keyboard.press(" ")
    until(page, "frame.index === 3 && !playing")
    box = page.locator("#chart").bounding_box()
    page.mouse.click(box["x"] + 0.75 * box["width"], box["y"] + 60)  # t = 0.22, after frame 2
    until(page, "frame.index === 2")


def test_wheel_zooms_at_the_pointer_and_f_fits(page, serve, path):
    opened(page, serve(path))
    x, y = spot(page, 10.0, 10.0)
    page.mouse.move(x, y)
    page.mouse.wheel(0, -1000)
    until(page, "view.zoom > 2 * fit.zoom")
    # The pointer is up to half a pixel off, of which the zoom by exp(1.5) makes 1.7, and the end is rounded.
    x_zoomed, y_zoomed = spot(page, 10.0, 10.0)
    assert np.abs(np.subtract((x_zoomed, y_zoomed), (x, y))).max() <= 2
    page.mouse.down()
    page.mouse.move(x + 50, y, steps=5)
    page.mouse.up()
    assert np.abs(np.subtract(spot(page, 10.0, 10.0), (x_zoomed + 50, y_zoomed))).max() <= 1
    page.keyboard.press("f")
    assert page.evaluate("view.zoom === fit.zoom && view.x === 15")


def test_a_click_shows_the_history_of_a_disk_or_that_it_was_not_tracked(page, serve, path):
    opened(page, serve(path))
    page.keyboard.press("End")
    until(page, "frame.index === 3")
    page.mouse.click(*spot(page, *viewed.state(3).position[viewed.TRACKED] + 0.1))
    until(page, "$('disk').innerText.includes('3 collisions')")
    rows = page.locator("#disk tr[data-time]").all_inner_texts()
    assert [text.split()[0] for text in rows] == ["0.05", "0.12", "0.25"]
    assert "(1, 2)" in rows[0]
    assert "(\N{MINUS SIGN}1, 2.5)" in rows[0]
    assert "wall 1" in rows[1]
    assert "0.25" in page.inner_text("#disk tr.latest")
    page.locator("#disk tr[data-time] button").first.click()  # t = 0.05: frame 0 is the one before
    until(page, "frame.index === 0")
    page.mouse.click(*spot(page, *viewed.state(0).position[11]))
    until(page, "$('disk').innerText.includes('Disk 11')")
    assert "It was not tracked" in page.inner_text("#disk")
    page.keyboard.press("Escape")
    assert page.locator("#disk").is_hidden()


def test_missing_colours_are_reported_with_the_reason(page, serve, tmp_path):
    layout_files.write(tmp_path / "bare.h5", n=20, fields=("position",))
    opened(page, serve(tmp_path / "bare.h5"))
    reasons = page.locator("#colour option[disabled]").all_text_contents()
    assert len(reasons) == 5
    assert any("output.histories" in one for one in reasons)
    until(page, "$('notes').innerText.includes('no marks that turn')")


def test_a_wrong_token_is_refused(page, serve, path):
    address = serve(path)
    wrong = "y" if address[-2] == "x" else "x"
    assert page.goto(f"{address[:-2]}{wrong}/").status == 403
    assert [one for one in page.wrong if "403" not in one] == []
    page.wrong.clear()


def test_frames_that_a_run_adds_are_followed(page, serve, tmp_path):
    with viewed.writer(tmp_path / "live.h5") as file:
        viewed.add(file, 0)
        opened(page, serve(tmp_path / "live.h5"))
        assert page.evaluate("head.times.length") == 1
        page.check("#follow")
        for frame in (1, 2):
            viewed.add(file, frame)
            until(page, f"head.times.length === {frame + 1} && frame.index === {frame}")
        page.uncheck("#follow")
        viewed.add(file, 3)
        until(page, "head.times.length === 4")
        assert page.evaluate("frame.index") == 2


def test_a_replaced_file_is_read_again(page, serve, path, tmp_path):
    path = shutil.copy(path, tmp_path / "first.h5")
    opened(page, serve(path))
    first = page.evaluate("[head.n, head.times.length, document.title]")
    viewed.layout_files.write(tmp_path / "other.h5", n=3, frames=first[1])
    (tmp_path / "other.h5").replace(path)
    until(page, "head.n === 3 && frame?.whole === 3")
    assert page.evaluate("[disks.of.radius.length, head.times.length]") == [3, first[1]]
    assert page.evaluate("document.title") != first[2]


def test_disks_come_back_after_the_browser_took_the_context_away(page, serve, path):
    opened(page, serve(path))
    before = pixels(page)
    page.evaluate("window.taken = gl.getExtension('WEBGL_lose_context'); taken.loseContext()")
    until(page, "gl.isContextLost()")
    page.evaluate("setTimeout(() => taken.restoreContext())")  # not before the page has heard of it
    until(page, "!gl.isContextLost() && !ask_paint.due")
    assert np.array_equal(pixels(page), before)


def test_a_server_that_does_not_answer_for_a_while_is_followed_on(page, serve, path):
    opened(page, serve(path))
    page.context.set_offline(True)
    until(page, "!$('trouble').hidden")
    assert "does not answer" in page.inner_text("#trouble")
    page.context.set_offline(False)
    until(page, "$('trouble').hidden")
    assert all("ERR_INTERNET_DISCONNECTED" in one for one in page.wrong)
    page.wrong.clear()


def test_one_file_draws_without_a_server(page, path, tmp_path):
    out = tmp_path / "sent.html"
    assert main(["--quiet", "view", str(path), "--html", str(out)]) == 0
    opened(page, out.as_uri())
    choose(page, "colour", "species")
    page.keyboard.press("End")
    until(page, "frame.index === 3")
    x, y = viewed.state(3).position[12]
    column, row = spot(page, x, y + 0.4)
    assert np.abs(pixels(page)[row, column] - (0, 114, 178)).max() <= 8
    page.mouse.click(*spot(page, *viewed.state(3).position[viewed.TRACKED] + 0.1))
    until(page, "$('disk').innerText.includes('3 collisions')")


@pytest.mark.parametrize("place", [1, 2, 3])
def test_one_file_holds_every_frame_also_as_differences(page, tmp_path, place):
    """Disks of a gas at rest but for some: frames are smaller as differences, and the page puts them together."""
    disks, frames = 4000, [layout_files.some_state(4000, 0) for _ in range(4)]
    for step, one in enumerate(frames):
        one.position[:] = np.random.default_rng(1).uniform((0.0, 0.0), layout_files.BOX.lengths, (disks, 2))
        one.position[:100] = np.mod(one.position[:100] + 0.1 * step, layout_files.BOX.lengths)
        one.angle = 0.001 * np.arange(disks) + 0.2 * step
        one.time = float(step)
    kinds = ifrdem.Disks(disks, mass=1.0, radius=0.05)
    fields = ("position", "angle")
    with ifrdem.TrajectoryWriter(tmp_path / "run.h5", kinds, layout_files.BOX, fields=fields) as file:
        for one in frames:
            file.write(one, {})
    out = tmp_path / "sent.html"
    assert main(["--quiet", "view", str(tmp_path / "run.h5"), "--html", str(out)]) == 0
    opened(page, out.as_uri())
    page.evaluate(f"show({place})")
    until(page, f"!busy && frame.index === {place}")
    assert page.evaluate("frame.differences.toSorted()") == ["angle", "position"]
    places = np.array(page.evaluate(f"Array.from({{length: {disks}}}, (_, i) => placeOf(i))"))
    assert np.abs(places - frames[place].position).max() <= 0.51 * 30.2 / 65535.0  # half a step of the window
    turns = np.array(page.evaluate("Array.from(frame.of.angle)"))[:disks] * 2.0 * np.pi / 65536.0
    assert (
        np.abs((turns - frames[place].angle + np.pi) % (2.0 * np.pi) - np.pi).max() <= 0.51 * np.pi / 32768.0
    )


def test_two_fingers_zoom_and_the_place_between_them_stays(page, serve, path):
    opened(page, serve(path))
    x, y = spot(page, 10.0, 10.0)
    fingers = page.context.new_cdp_session(page)
    for kind, apart in (("touchStart", 40), ("touchMove", 60), ("touchMove", 80), ("touchMove", 120)):
        points = [{"x": x - apart, "y": y, "id": 1}, {"x": x + apart, "y": y, "id": 2}]
        fingers.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    fingers.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    assert page.evaluate("view.zoom / fit.zoom") == pytest.approx(3.0, rel=0.05)
    assert np.abs(np.subtract(spot(page, 10.0, 10.0), (x, y))).max() <= 4
    assert page.evaluate("selected") == -1


def test_the_page_draws_in_the_frame_of_a_notebook(page, path, tmp_path):
    notebook = tmp_path / "notebook.html"
    notebook.write_text(f"<!doctype html><meta charset=utf-8>{ifrdem.view(path)._repr_html_()}")
    page.goto(notebook.as_uri())
    inside = page.frames[1]
    until(inside, "head !== null && frame !== null && !busy && head.times.length === 4")
    assert inside.inner_text("#title").startswith("run: 40 disks")


def test_points_of_a_study_open_their_runs(page, serve, tmp_path):
    opened(page, serve(some_results(tmp_path), "--study"))
    until(page, "head.n === 40")  # of the first point, a run was kept
    assert page.inner_text("#point") == "e_n = 0.7"
    assert page.locator("#runs button:enabled").all_text_contents() == ["seed 2"]
    box = page.locator("#points").bounding_box()
    place = page.evaluate("(() => { const drawn = drawStudy(); return [drawn.px(0.9), drawn.py(12)] })()")
    page.mouse.click(box["x"] + place[0], box["y"] + place[1])
    until(page, "$('point').textContent === 'e_n = 0.9'")
    assert "were not kept" in page.inner_text("#kept")


def test_many_disks_are_a_map_until_the_view_is_narrow(page, serve, path):
    opened(page, serve(path, first="from ifrdem.viewer import content; content.MOST_DISKS = 20"))
    assert page.evaluate("frame.shape.length") == 2
    until(page, "$('notes').innerText.includes('area fraction in cells of')")
    page.evaluate("zoomAt(300, 200, 16)")
    until(page, "!busy && !frame.shape && count() < 20")
    until(page, "$('notes').innerText === ''")


SIZES = {"narrow": (390, 844), "wide": (1400, 900)}


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_fault_with_a_disk_chosen_nor_in_a_study(browser, serve, path, tmp_path, scheme, size):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe is not installed").Axe()
    width, height = SIZES[size]
    context = browser.new_context(viewport={"width": width, "height": height}, color_scheme=scheme)
    context.set_default_timeout(1000.0 * PATIENCE)
    for address in (serve(path), serve(some_results(tmp_path), "--study")):
        page = context.new_page()
        opened(page, address)
        page.evaluate("choose(3)")
        until(page, "!$('disk').hidden && $('disk').innerText.includes('Disk 3')")
        found = [
            (each["id"], [node["html"] for node in each["nodes"]])
            for each in axe.run(page).response["violations"]
        ]
        assert found == []
    context.close()


@pytest.mark.parametrize("size", SIZES)
def test_a_panel_that_opens_moves_no_disk_and_on_narrow_pages_covers_none(page, serve, path, size):
    width, height = SIZES[size]
    page.set_viewport_size({"width": width, "height": height})
    opened(page, serve(path))
    before = spot(page, *viewed.state(0).position[11])
    page.mouse.click(*before)
    until(page, "!$('disk').hidden && $('disk').innerText.includes('Disk 11')")
    assert spot(page, *viewed.state(0).position[11]) == before
    if size == "narrow":
        stage, panel = (page.locator(id).bounding_box() for id in ("#stage", "#disk"))
        assert panel["y"] >= stage["y"] + stage["height"]
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_targets_of_touch_have_40_pixels(browser, serve, path):
    context = browser.new_context(viewport={"width": 390, "height": 844}, has_touch=True)
    context.set_default_timeout(1000.0 * PATIENCE)
    page = context.new_page()
    opened(page, serve(path))
    targets = "button, select, label, input:not(label *)"
    found = f"[...document.querySelectorAll('header, footer')].flatMap(one => [...one.querySelectorAll('{targets}')])"
    too_small = "one => one.offsetParent && (one.offsetHeight < 40 || one.offsetWidth < 40)"
    small = page.evaluate(f"{found}.filter({too_small}).map(one => one.outerHTML)")
    assert small == []
    context.close()


def test_the_view_moves_and_disks_are_chosen_by_keys(page, serve, path):
    opened(page, serve(path))
    whole = page.evaluate("({...view})")
    for _ in range(3):
        page.keyboard.press("+")
    page.keyboard.press("Shift+ArrowRight")
    page.keyboard.press("Shift+ArrowUp")
    now = page.evaluate("({...view, width: stage.clientWidth, height: stage.clientHeight, index})")
    assert now["zoom"] == pytest.approx(whole["zoom"] * 1.25**3)
    assert now["x"] == pytest.approx(whole["x"] + 0.1 * now["width"] / now["zoom"])
    assert now["y"] == pytest.approx(whole["y"] + 0.1 * now["height"] / now["zoom"])
    assert now["index"] == 0
    page.keyboard.press("-")
    assert page.evaluate("view.zoom") == pytest.approx(whole["zoom"] * 1.25**2)
    page.fill("#number", "7")
    page.press("#number", "Enter")
    until(page, "$('disk').innerText.includes('Disk 7')")
    page.locator("#above").focus()
    page.keyboard.press("]")
    until(page, "$('disk').innerText.includes('Disk 8')")
    page.keyboard.press("[")
    until(page, "$('disk').innerText.includes('Disk 7')")
    assert page.input_value("#number") == "7"
    page.keyboard.press("Escape")
    assert page.evaluate("selected") == -1
    assert "Shift and arrows move" in page.get_attribute("#above", "aria-label")
    assert page.get_attribute("#chart", "aria-label").startswith("graph of ")


def test_a_study_without_disks_shows_no_empty_stage(page, serve, tmp_path):
    opened(page, serve(some_results(tmp_path), "--study"))
    page.select_option("#which", index=1)
    until(page, "$('point').textContent === 'e_n = 0.8'")
    until(page, "document.body.classList.contains('bare')")
    for id in ("#stage", "#play", "#fit"):
        assert not page.locator(id).is_visible()
    assert page.locator("#study").bounding_box()["width"] == 900
    assert page.locator("#chart").is_visible()
    page.select_option("#which", index=0)
    until(page, "head?.n === 40 && !document.body.classList.contains('bare')")
    assert page.locator("#stage").is_visible()


@pytest.mark.parametrize("width", [1280, 900])
def test_curves_stand_beside_a_square_box_and_the_title_is_whole(page, serve, tmp_path, width):
    """The right half of the page was empty, and the title ended in an ellipsis."""
    units = {"length": "m", "time": "s", "mass": "kg", "energy": "J", "angle": "rad"}
    name = "a_gas_of_coins_with_a_long_name"
    disks, velocity = ifrdem.Disks(2, 1.0, 0.5), [[1.0, 0.0], [0.0, 0.5]]
    with ifrdem.TrajectoryWriter(
        tmp_path / "a.h5", disks, ifrdem.Box((9.0, 9.0)), parameters={"name": name}, units=units
    ) as file:
        for t in (0.0, 1.0):
            state = ifrdem.State([[2.0, 2.0], [6.0, 6.0]], velocity, [t, -t], time=t)
            file.write(state, {"temperature": 2.0 - t, "rotational_temperature": t, "collisions": 0})
    page.set_viewport_size({"width": width, "height": 720})
    opened(page, serve(tmp_path / "a.h5"))
    assert page.input_value("#colour") == "speed"
    stage, chart = (page.locator(id).bounding_box() for id in ("#stage", "#chart"))
    assert page.locator("#title").inner_text().startswith(name)
    assert page.evaluate("$('title').scrollWidth <= $('title').clientWidth")
    assert (chart["x"] >= stage["x"] + stage["width"] > 0.4 * width) == (width == 1280)
    assert (chart["height"] > 0.6 * stage["height"]) == (width == 1280)
    assert chart["x"] + chart["width"] > 0.97 * width
    page.evaluate("show(1)")
    until(page, "index === 1 && !busy")
    cursor = page.evaluate("curves.drawn.px(1)")  # the present time is marked
    shown = pixels(page)
    column = round(chart["x"] + cursor)
    middle = shown[round(chart["y"] + 0.5 * chart["height"]), column - 2 : column + 3]
    assert middle.max(axis=1).min() < 120  # 1.5 pixels wide, so between ink and paper; no curve is grey


def test_marks_of_axes_have_equal_distances(page, serve, path):
    opened(page, serve(path))
    for low, high, log in ((0.0, 7.3, False), (0.02, 900.0, True), (1e-7, 1e5, True)):
        found = np.array(page.evaluate(f"ticks({low}, {high}, {str(log).lower()}, 5)"))
        steps = np.diff(np.log(found) if log else found)
        assert len(found) > 2
        assert steps == pytest.approx(np.full(len(steps), steps[0]))
    assert page.evaluate("ticks(0.3, 4, true, 5)") == [0.5, 1, 2]
