"""Laws of the tray and impacts on it, in films of a simulator that shares no code with the fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support import track_simulator as simulator
from support.track_coverage import DISKS, WALLS

from ifrdem.cli.main import main
from ifrdem.errors import InputError
from ifrdem.fit import Disk, impacts, tracks
from ifrdem.fit.flight import Tray
from ifrdem.fit.tray import Piece, estimate

FPS = 120.0
MU_G = 2.0
COINS = simulator.Tray(MU_G, contact="face")


@pytest.fixture(scope="module")
def coins() -> simulator.Motion:
    """Six clips of coins that slide and spin to rest, 0.8 s each; 12 of 20 rest at first in half of them."""
    each = [
        simulator.simulate(
            FPS, 0.8, i, tray=COINS, speed=1.0 if i % 2 else 1.4, spin=10.0, resting=0 if i % 2 else 12
        )
        for i in range(6)
    ]
    return simulator.clips(each, 0.5)


@pytest.fixture(scope="module")
def film(coins: simulator.Motion, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("coins") / "tracks.csv"
    path.write_text(simulator.film(coins, 1, lost=0.01, numbered=True), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def found(film: Path) -> impacts.FoundCollisions:
    return impacts.find(tracks.read(film, fps=FPS), DISKS, walls=WALLS)


@pytest.mark.full
def test_the_law_and_its_constant_are_found(found: impacts.FoundCollisions) -> None:
    """The face of a coin, not its edge, nor centre and spin apart; no tilt, which is 0."""
    assert found.tray is not None
    assert found.tray.tray.law == "coin"
    assert found.tray.names == ("a0",)
    assert abs(found.tray.tray.a0 - MU_G) < 4.0 * found.tray.error("a0") < 0.01
    assert found.tray.fits
    assert found.tray.chi2 == pytest.approx(found.tray.dof, rel=0.05)
    assert not found.trays
    assert not found.warnings
    assert found.tray_text()[0].startswith("coins slide and spin on their faces with mu g = 2.0")


@pytest.mark.full
def test_velocities_and_spins_at_impacts_are_those_of_the_film(
    found: impacts.FoundCollisions, coins: simulator.Motion
) -> None:
    """With straight flights the root mean square is above 10, and with law "plain" that of spins 3."""
    pulls: dict[str, list[float]] = {"v": [], "spin": []}
    starts = [coins.t[np.searchsorted(coins.clip, c)] for c in range(6)]
    for columns in (found.pairs, found.walls):
        for at in range(len(columns["t"])):
            row = {name: float(value[at]) for name, value in columns.items()}
            if row["quality"] < impacts.POOR:
                continue
            time = row["t"] + starts[int(row["clip"])]
            ids = [int(row[name]) for name in ("id_1", "id_2") if name in row]
            near = [
                each
                for each in coins.impacts
                if abs(each.t - time) < 0.02 and {*ids} == ({each.i} if each.j < 0 else {each.i, each.j})
            ]
            if not near:
                continue
            true = min(near, key=lambda each: abs(each.t - time))
            for n, one in enumerate(ids, start=1):
                for q, name in enumerate(("vx", "vy", "spin")):
                    for end, of in (("", true.before), ("_after", true.after)):
                        column = f"{name}_{n}{end}"
                        off = row[column] - of[int(one != true.i), q]
                        pulls["spin" if q == 2 else "v"].append(off / row[f"{column}_error"])
    for each in pulls.values():
        assert len(each) > 150
        assert 0.85 < np.sqrt(np.mean(np.square(each))) < 1.2
        assert np.mean(np.abs(each) < 1.96) > 0.9


@pytest.mark.full
def test_ids_used_again_are_those_of_another_clip(
    found: impacts.FoundCollisions, coins: simulator.Motion
) -> None:
    """Each gap made 20 false exchanges, and encounters of all disks that jump past each other."""
    assert not found.exchanges
    assert len(found.tracks.clips) == 6
    assert {*found.pairs["clip"]} <= {*range(6)}
    assert float(np.max(found.pairs["t"])) < 0.8  # of each clip
    assert found.reasons["a flight has fewer than 3 frames"] < 0.5 * len(coins.impacts)


def test_clips_are_found_where_no_disk_can_have_moved_so(coins: simulator.Motion, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(simulator.film(coins, 1), encoding="utf-8")
    by_gap = tracks.read(tmp_path / "a.csv", fps=FPS)
    (tmp_path / "b.csv").write_text(simulator.film(coins, 1, numbered=True), encoding="utf-8")
    by_column = tracks.read(tmp_path / "b.csv", fps=FPS)
    assert len(by_gap.clips) == len(by_column.clips) == 6
    assert by_column.when(by_column.time[0][-1]) == (5, pytest.approx(95.0 / FPS))
    text = simulator.film(simulator.simulate(FPS, 1.0, 1), 1).splitlines()
    lost = [line for line in text if not line[0].isdigit() or not 50 <= int(line.split(",")[0]) < 58]
    (tmp_path / "c.csv").write_text("\n".join(lost) + "\n", encoding="utf-8")
    assert len(tracks.read(tmp_path / "c.csv", fps=FPS).clips) == 1  # frames that were lost


@pytest.mark.full
def test_straight_flights_on_such_a_tray_blame_the_tray(film: Path) -> None:
    """They blamed k, the radii and units, which are right."""
    found = impacts.find(tracks.read(film, fps=FPS), DISKS, walls=WALLS, friction="none")
    (warning,) = found.warnings
    assert "coins slide and spin on their faces with mu g = " in warning
    assert "friction = 'estimate' takes it into account" in warning
    assert found.tray_text()[0] == "flights are taken as straight"


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("slippery", [1.0, 0.7])
def test_kinds_of_disks_that_differ_have_their_own_constants(slippery: float, tmp_path: Path) -> None:
    """On a tray that slows down material B by 0.7 times as much, or by as much."""
    tray = simulator.Tray(0.4, slippery=slippery)
    motion = simulator.simulate(FPS, 0.8, 3, tray=tray, speed=0.5)
    (tmp_path / "tracks.csv").write_text(simulator.film(motion, 3), encoding="utf-8")
    found = impacts.find(tracks.read(tmp_path / "tracks.csv", fps=FPS), DISKS, walls=WALLS, friction="plain")
    if slippery == 1.0:
        assert not found.trays
        return
    assert len(found.trays) == 2
    for (mass, _, _), each in found.trays.items():
        true = 0.4 * (1.0 if mass == simulator.MASS[0] else slippery)
        assert abs(each.tray.a0 - true) < 4.0 * each.error("a0")


@pytest.mark.full
def test_an_air_table_that_is_tilted(tmp_path: Path) -> None:
    true = Tray(a0=0.02, a1=0.03, b0=0.1, b1=0.03, gx=0.05, gy=-0.02)
    tray = simulator.Tray(0.02, 0.03, 0.1, 0.03, (0.05, -0.02))
    motion = simulator.simulate(FPS, 4.0, 5, tray=tray)
    (tmp_path / "tracks.csv").write_text(simulator.film(motion, 5), encoding="utf-8")
    estimate = impacts.find(tracks.read(tmp_path / "tracks.csv", fps=FPS), DISKS, walls=WALLS).tray
    assert estimate is not None
    assert {"gx", "gy"} <= {*estimate.names}
    for name in ("gx", "gy"):
        assert abs(getattr(estimate.tray, name) - getattr(true, name)) < 4.0 * estimate.error(name) < 0.01
    # a0 and a1 are correlated: between slow and fast disks their sum is known
    assert estimate.tray.braking(0.5, 0.0) == pytest.approx(true.braking(0.5, 0.0), abs=0.004)
    assert "mrad" in estimate.text()
    assert "; straight flights without slowing: chi2 " in estimate.text()


@pytest.mark.parametrize("friction", ["glue", "coin=", "coin=-1", "1,2,3,4,5", "-1", "nan"])
def test_laws_that_do_not_exist_are_refused(
    friction: str, film: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["collisions", str(film), "--fps", "120", "--disk", "1,1", f"--friction={friction}"]) == 2
    allowed = "must be estimate, none, plain, coin, ring, coin=MU, ring=MU or A0[,A1[,B0[,B1]]]"
    assert f"--friction {friction}: {allowed}" in capsys.readouterr().err


def test_a_coupled_law_needs_angles(film: Path) -> None:
    seen = tracks.read(film, fps=FPS)
    blind = tracks.Tracks(seen.time, seen.position, {}, "blind")
    with pytest.raises(InputError, match="friction coin: requires angles of the disks"):
        impacts.find(blind, DISKS, friction="coin")


def test_wrong_radii_are_named_also_of_tracks_without_angles(film: Path) -> None:
    """The warning of spins that were not seen kept silent what the paths say of the radii, 3 % too large."""
    seen = tracks.read(film, fps=FPS)
    part = {i: t < 2.6 for i, t in seen.time.items()}  # two clips
    time, place = ({i: each[i][part[i]] for i in part} for each in (seen.time, seen.position))
    blind = tracks.Tracks(time, place, {}, "blind", clips=seen.clips)
    large = {i: Disk(mass=d.mass, radius=1.03 * float(np.asarray(d.radius))) for i, d in DISKS.items()}
    warnings = impacts.find(blind, large).warnings
    assert any("angles were not tracked" in each for each in warnings)
    assert any("turn at 0.97" in each for each in warnings)


def test_disks_that_rest_do_not_hide_those_that_move() -> None:
    """300 long pieces of disks at rest, and 40 flights of 0.25 s: the former were all that was used."""
    rng, true = np.random.default_rng(1), Tray(law="coin", a0=MU_G)
    pieces = []
    for i in range(340):
        tau = np.arange(60 if i < 300 else 30) / FPS
        v, w = rng.normal(0.0, 1.0, (1, 2)) * (i >= 300), rng.normal(0.0, 10.0, 1) * (i >= 300)
        moved, turned = true.flight(tau[None], v, w, 0.025, 2.0)
        x = moved[0] + 3e-4 * rng.standard_normal((len(tau), 2))
        angle = turned[0] + 0.0175 * rng.standard_normal(len(tau))
        pieces.append(Piece(tau, x, angle, np.full(2, 3e-4), 0.0175, 0.025, 2.0))
    found = estimate(pieces)
    assert found.tray.law == "coin"
    assert abs(found.tray.a0 - MU_G) < 4.0 * found.error("a0") < 0.05
