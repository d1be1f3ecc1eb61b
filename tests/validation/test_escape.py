"""No disk gets through a wall, of any kind; the long run is `python -m ifrdem.validation.gas.escape`."""

from __future__ import annotations

from dataclasses import replace

import pytest

from ifrdem.errors import EngineError
from ifrdem.model.walls.wall import Wall
from ifrdem.tools.arguments import script
from ifrdem.validation.gas import escape


@pytest.mark.full
@pytest.mark.parametrize(
    ("where", "order", "hits"),
    [
        ("kinds", "tiled", 3_000),
        ("kinds", "serial", 60_000),
        ("corners", "serial", 100_000),
    ],
)
def test_no_disk_escapes(where: str, order: str, hits: int) -> None:
    found = escape.run(hits, order, where=where)
    assert found.hits >= hits
    assert found.states > 500
    assert found.least_gap < 0.01  # they do come near
    assert found.least_gap > -1e-11  # rounding of places near 30 is 4e-15


@pytest.mark.full
def test_an_escape_would_be_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """A wall that the engine does not know: disks cross it."""
    room = escape.room

    def with_a_hole(order: str, seed: int) -> object:
        engine = room(order, seed=seed)
        unknown = Wall.line((0.0, 20.0), (0.0, -1.0))
        engine.setup = replace(engine.setup, walls=(*engine.setup.walls, unknown))
        return engine

    monkeypatch.setitem(escape.ROOMS, "kinds", with_a_hole)
    with pytest.raises(EngineError, match=r"disk \d+ overlaps wall 8 \(line\)"):
        escape.run(2_000)


def test_bad_options_end_with_status_2(capsys: pytest.CaptureFixture[str]) -> None:
    assert script(escape.escape, ["--hits", "1.5"]) == 2
    assert script(escape.escape, ["--order", "serail"]) == 2
    assert "did you mean 'serial'" in capsys.readouterr().err
    assert script(escape.escape, ["--room", "corner"]) == 2
    assert "did you mean 'corners'" in capsys.readouterr().err
