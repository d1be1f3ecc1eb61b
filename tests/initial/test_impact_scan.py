"""Impact scans: the paper's experiment as a case."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ifrdem.case import file as case_file
from ifrdem.case.gas import CaseGas
from ifrdem.cli import main as cli
from ifrdem.errors import InputError
from ifrdem.initial import impact_scan
from ifrdem.model.state import Disks
from ifrdem.plots import impact_angles as scan_picture
from ifrdem.simulation import backend
from ifrdem.trajectory.reader import Trajectory

CASE = Path(__file__).parents[2] / "cases" / "impact_scan.toml"


def changed(*changes: str) -> list[str]:
    return [word for change in changes for word in ("--set", change)]


def test_the_scan_gives_the_papers_two_lines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Equal homogeneous disks: m_t = m_n / 3, so tan(delta_2) = P_t / P_n, by hand from Eqs. 5, 8, 9 and 15,

    = tan(psi) (1 + e_t) / (3 (1 + e_n)) + min(mu, tan(psi) / (2 (1 + e_n))); they meet at 2 mu (1 + e_n) (Eq. 25).
    """
    monkeypatch.chdir(tmp_path)
    drawn: dict[str, Any] = {}
    monkeypatch.setattr(scan_picture, "save", lambda figure, path: drawn.update(figure=figure))
    few = ["species[0].number=60", "species[1].number=60"]
    assert cli.main(["run", str(CASE), *changed(*few)]) == 0
    with Trajectory("impact_scan.h5") as trajectory:
        tan_psi, tan_delta = scan_picture.measured(trajectory)
    np.testing.assert_allclose(tan_psi, np.tan(np.radians(np.linspace(0.0, 80.0, 60))), atol=1e-12)
    e_n, e_t, mu = 0.67, -0.95, 0.14
    by_hand = tan_psi * (1 + e_t) / (3 * (1 + e_n)) + np.minimum(mu, tan_psi / (2 * (1 + e_n)))
    np.testing.assert_allclose(
        tan_delta, by_hand, atol=1e-11
    )  # rounding of places some hundred diameters away
    upper, lower = drawn["figure"].axes
    labels = [text.get_text() for text in upper.get_legend().get_texts()]
    assert "sticking and sliding meet, $\\tan\\psi$ = 0.4676" in labels
    assert upper.get_ylabel() == r"$\tan\delta_2$ of the disk that was hit"
    assert "simulated" in lower.get_ylabel()


def test_lines_of_centres_are_where_the_disks_touch() -> None:
    """Unequal radii; the angle between velocity and line of centres is psi, on both sides of 0."""
    disks = Disks(14, mass=1.0, radius=np.repeat([0.5, 0.8], 7))
    given = impact_scan.start(disks, (-80.0, 80.0), 2.0, seed=3)
    assert given.velocity is not None
    position, velocity = (
        np.swapaxes(values.reshape(2, 7, 2), 0, 1) for values in (given.position, given.velocity)
    )
    n = impact_scan.line_of_centres(position, velocity, np.full(7, 1.3))
    v = velocity[:, 0] / 2.0
    np.testing.assert_allclose(np.linalg.norm(v, axis=1), 1.0, rtol=1e-14)
    sine, cosine = n[:, 0] * v[:, 1] - n[:, 1] * v[:, 0], np.sum(n * v, axis=1)
    np.testing.assert_allclose(np.degrees(np.arctan2(sine, cosine)), np.linspace(-80.0, 80.0, 7), atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (["box.open=", "box.packing_fraction=0.1"], r"pairs that fly apart need box\.open = true"),
        (["species[1].number=5"], r"two species with equal numbers.*321 of 'hitting', 5 of 'hit'"),
        (
            ["species[1].speed_rms=1.0"],
            r"species\[1\]\.speed_rms = 1: cannot be combined with start\.positions",
        ),
        (["start.speed="], r"speed is missing"),
        (["start.positions=random"], r"psi, speed: requires positions = \"impact_scan\""),
        (["start.psi=[0.0, 95.0]"], r"start\.psi\[1\] = 95\.0: must be an angle above -90 and below 90"),
        (["box.packing_fraction=0.1"], r"box\.packing_fraction: cannot be combined with box\.open = true"),
        (['force=[{kind="drag", step=0.1, rate=1.0}]'], r"no \[\[force\]\] can act in a scan"),
    ],
)
def test_what_cannot_be_a_scan_is_refused_by_key(changes: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        case_file.read(CASE, changes)


def test_a_scan_beyond_the_memory_is_refused_before_it_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(backend, "memory_available", lambda: 100_000)
    monkeypatch.setattr(impact_scan, "start", lambda *_args, **_options: pytest.fail("it was made"))
    with pytest.raises(InputError, match=r"impact_scan\.toml: 642 disks need some .* of memory, and 100 kB"):
        case_file.read(CASE)


def test_a_scan_that_has_not_hit_is_not_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    words = changed(
        "run.collisions_per_disk=", "run.t_end=1e-6", "species[0].number=9", "species[1].number=9"
    )
    assert cli.main(["run", str(CASE), "--no-picture", *words]) == 0
    with Trajectory("impact_scan.h5") as trajectory, pytest.raises(InputError, match="collided 0 times"):
        scan_picture.measured(trajectory)


def test_check_says_that_the_box_is_open(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["check", str(CASE)]) == 0
    shown = capsys.readouterr().out
    assert "642 disks in an open box, SI units" in shown
    assert "packing fraction" not in shown
    assert "an unknown number of collisions" in shown or "321 collisions" in shown


def test_the_seed_decides_the_directions_only() -> None:
    file = case_file.read(CASE)
    gas = CaseGas.from_case(file.case)
    other = CaseGas.from_case(case_file.read(CASE, ["run.seed=2"]).case)
    assert gas.given is not None
    assert other.given is not None
    assert np.any(gas.given.position != other.given.position)
    np.testing.assert_array_equal(gas.disks.mass, other.disks.mass)
