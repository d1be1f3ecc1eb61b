"""Averages in bins: made-up gases of known averages, errors that cover, and collisions of real gases."""

from __future__ import annotations

import json
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from support.cases import Written, case_text

import ifrdem
from ifrdem import Box, Disks, State, Trajectory, TrajectoryWriter, Wall, analysis
from ifrdem.analysis import averages, catalogue
from ifrdem.analysis.bins import Strips
from ifrdem.errors import InputError

BOX = Box((20.0, 10.0))
N = 4000


def write_frames(path: Path, make, *, frames=10, box=BOX, n=N, **options) -> Path:
    """Frames at t = 0, 1, ...: `make(rng, disks)` gives positions, velocities and spins."""
    rng = np.random.default_rng(7)
    disks = Disks(n, np.where(np.arange(n) % 2 == 0, 1.0, 3.0), 0.1)
    with TrajectoryWriter(path, disks, box, precision="f64", **options) as file:
        for time in range(frames):
            position, velocity, spin = make(rng, disks)
            file.write(State(position, velocity, spin, time=float(time)))
    return path


def thermal(rng, disks, T_x=4.0, T_y=9.0, T_rot=2.0):
    v = rng.normal(size=(disks.n, 2)) * np.sqrt([T_x, T_y]) / np.sqrt(disks.mass)[:, None]
    return v, rng.normal(size=disks.n) * np.sqrt(T_rot / disks.inertia)


def within(found: analysis.BinAverages, name: str, expected, errors: float = 5.0) -> None:
    """A quantity agrees with a number in each bin, within its own standard errors, which are known."""
    mean, error = (np.asarray(getattr(one, name)) for one in (found.mean, found.error))
    assert np.all(error > 0.0), name
    deviation = np.abs(mean - expected) / error
    assert deviation.max() < errors, f"{name}: {deviation.max():.1f} errors"


def test_a_gas_that_flows_has_this_flow_and_temperatures_about_it(tmp_path: Path) -> None:
    """u = (2 + y / 5, 0): what u varies by in a strip of width w adds m (w / 5)^2 / 12 to T_x."""

    def make(rng, disks):
        position = rng.random((disks.n, 2)) * BOX.lengths
        v, spin = thermal(rng, disks)
        return position, v + np.stack((2.0 + 0.2 * position[:, 1], np.zeros(disks.n)), axis=1), spin

    with Trajectory(write_frames(tmp_path / "a.h5", make, frames=40)) as run:
        found = analysis.profiles(run, "y", 10, frames=range(40))
        grid = analysis.mean_fields(run, (4, 5), frames=range(40))
    (y,) = found.middles
    within(found, "velocity", np.stack((2.0 + 0.2 * y, np.zeros(10)), axis=1))
    inside = 2.0 * 0.2**2 / 12.0  # of the mean mass 2
    within(found, "temperatures", [4.0 + inside, 9.0])
    within(found, "temperature", 6.5 + 0.5 * inside)
    within(found, "rotational_temperature", 2.0)
    within(found, "theta", 2.0 / 6.5)
    within(found, "number_density", N / 200.0)
    within(found, "packing_fraction", N * math.pi * 0.01 / 200.0)
    n = N / 200.0
    within(found, "stress_kinetic", [[n * (4.0 + inside), 0.0], [0.0, n * 9.0]])
    within(found, "heat_flux_kinetic", 0.0)
    assert not found.has_collisions
    assert np.isnan(found.mean.stress).all()
    assert found.disks.sum() == 40 * N
    np.testing.assert_allclose(found.mean.packing_fraction.mean(), N * math.pi * 0.01 / 200.0, rtol=1e-12)
    assert grid.mean.velocity.shape == (4, 5, 2)
    within(grid, "velocity", np.stack(np.broadcast_arrays(2.0 + 0.2 * grid.middles[1], 0.0), axis=-1))
    np.testing.assert_allclose(grid.mean.packing_fraction.mean(), N * math.pi * 0.01 / 200.0, rtol=1e-12)


def test_velocities_of_third_moments_carry_heat(tmp_path: Path) -> None:
    """v_y is 2 or -1, of probabilities 1/3 and 2/3: <v_y^2> = 2, <v_y^3> = 2. v_x is +-1. Spins fast with v_y = 2.

    Of mass 1 and 3, each half: sum m (v_x^2 + v_y^2) v_y / 2 = n <m> (0 + 2) / 2 = 2 n; I w^2 = 3 where v_y is 2, 0
    elsewhere, carries n (3 * 2 / 3) / 2 = n. The whole drifts by (5, 7).
    """

    def make(rng, disks):
        fast = rng.random(disks.n) < 1.0 / 3.0
        velocity = np.stack((rng.choice([-1.0, 1.0], disks.n), np.where(fast, 2.0, -1.0)), axis=1)
        spin = np.where(fast, np.sqrt(3.0 / disks.inertia), 0.0)
        return rng.random((disks.n, 2)) * BOX.lengths, velocity + np.array((5.0, 7.0)), spin

    with Trajectory(write_frames(tmp_path / "a.h5", make, frames=60)) as run:
        found = analysis.profiles(run, "x", 5, frames=range(60))
    within(found, "velocity", (5.0, 7.0))
    within(found, "heat_flux_kinetic", [0.0, 3.0 * N / 200.0])


def test_errors_are_those_of_many_independent_gases(tmp_path: Path) -> None:
    """Deviations over errors of 60 strips have the rms 1, to the scatter of 60 x 20 blocks: 0.8 to 1.25."""

    def make(rng, disks):
        return (rng.random((disks.n, 2)) * BOX.lengths, *thermal(rng, disks))

    with Trajectory(write_frames(tmp_path / "a.h5", make, frames=100)) as run:
        found = analysis.profiles(run, "x", 60, frames=range(100))
    n = N / 200.0
    expected = {
        "number_density": n, "velocity": 0.0, "temperatures": [4.0, 9.0], "theta": 2.0 / 6.5,
        "rotational_temperature": 2.0, "stress_kinetic": [[4.0 * n, 0.0], [0.0, 9.0 * n]], "heat_flux_kinetic": 0.0,
    }  # fmt: skip
    for name, value in expected.items():
        pull = (getattr(found.mean, name) - value) / getattr(found.error, name)
        rms = np.sqrt(np.mean(pull**2, axis=0))
        assert np.all((rms > 0.8) & (rms < 1.35)), (name, rms)


def test_errors_know_that_frames_are_correlated(tmp_path: Path) -> None:
    """Each frame is there five times: the same mean, and the error of as many independent frames as there are."""

    def gas(rng, disks):
        return (rng.random((disks.n, 2)) * BOX.lengths, *thermal(rng, disks))

    held: list = []

    def make(rng, disks):
        if len(held) % 5 == 0:
            held.append(gas(rng, disks))
        else:
            held.append(held[-1])
        return held[-1]

    with Trajectory(write_frames(tmp_path / "a.h5", make, frames=200, n=1000)) as run:
        all_ = analysis.profiles(run, "x", 40, frames=range(200))
        once = analysis.profiles(run, "x", 40, frames=range(0, 200, 5))
    np.testing.assert_allclose(all_.mean.velocity, once.mean.velocity, rtol=1e-9)
    ratio = np.sqrt(np.mean(all_.error.velocity**2) / np.mean(once.error.velocity**2))
    assert ratio == pytest.approx(1.0, abs=0.1)


def test_rings_of_a_rotating_gas(tmp_path: Path) -> None:
    """u = Omega r along the tangent and T_r = T_t; uniform in the free area between a post and a drum."""
    drum, post, box = (
        Wall.container((5.0, 5.0), 4.5),
        Wall.post((5.0, 5.0), 1.0),
        Box((10.0, 10.0), (False, False)),
    )

    def make(rng, disks):
        r = np.sqrt(rng.uniform(1.1**2, 4.4**2, disks.n))
        angle = rng.uniform(0.0, 2.0 * np.pi, disks.n)
        away = np.stack((r * np.cos(angle), r * np.sin(angle)), axis=1)
        v, spin = thermal(rng, disks, 4.0, 4.0)
        return 5.0 + away, v + 0.5 * away[:, ::-1] * (-1.0, 1.0), spin

    with Trajectory(write_frames(tmp_path / "a.h5", make, box=box, walls=[drum, post], frames=20)) as run:
        found = analysis.profiles(run, "r", 7, frames=range(20))
    (r,) = found.middles
    assert (found.axes, found.directions) == (("r",), ("r", "t"))
    assert (found.edges[0][0], found.edges[0][-1]) == (1.0, 4.5)
    inner = slice(1, -1)  # no centre is within a radius of the walls
    for name, expected in {
        # u_t is the mean over the ring: Omega (r + w^2 / 12 r), w = 0.5.
        "velocity": np.stack((0.0 * r, 0.5 * (r + 0.25 / (12.0 * r))), axis=1)[inner],
        "number_density": np.full(5, N / (math.pi * (4.4**2 - 1.1**2))),
    }.items():
        mean, error = (getattr(one, name)[inner] for one in (found.mean, found.error))
        assert np.abs((mean - expected) / error).max() < 5.0, name
    np.testing.assert_allclose(found.mean.temperatures[inner], 4.0, rtol=0.06)
    total = (found.mean.packing_fraction * np.pi * np.diff(found.edges[0] ** 2)).sum()
    assert total == pytest.approx(N * math.pi * 0.01, rel=1e-12)


def test_a_sheared_box_has_its_flow_and_no_heat_of_it_in_the_temperature(tmp_path: Path) -> None:
    box = Box((20.0, 10.0), shear_rate=3.0)

    def make(rng, disks):
        position = rng.random((disks.n, 2)) * box.lengths
        v, spin = thermal(rng, disks)
        return position, v + box.flow(position), spin

    with Trajectory(write_frames(tmp_path / "a.h5", make, box=box, frames=40)) as run:
        found = analysis.profiles(run, "y", 5, frames=range(40))
    within(found, "velocity", np.stack((3.0 * (found.middles[0] - 5.0), np.zeros(5)), axis=1))
    within(found, "temperatures", [4.0, 9.0])  # with the flow within a strip T_x would be 4 + 6


@pytest.mark.filterwarnings("error")
def test_an_open_box_has_temperatures_and_cells_but_no_area_of_strips(tmp_path: Path) -> None:
    def make(rng, disks):
        return (rng.random((disks.n, 2)) * (20.0, 10.0) - (0.0, 5.0), *thermal(rng, disks))

    floor = Wall.line((0.0, -6.0), (0.0, 1.0))
    post = Wall.post((50.0, 50.0), 1.0)
    with Trajectory(write_frames(tmp_path / "a.h5", make, box=Box.open(), walls=[floor, post])) as run:
        found = analysis.profiles(run, "y", 5, frames=range(10))
        grid = analysis.mean_fields(run, (4, 2), frames=range(10))
        rings = analysis.profiles(run, "r", 5, frames=range(10))
    np.testing.assert_allclose(found.edges[0][[0, -1]], [-5.1, 5.1], atol=0.01)  # what the disks reach
    within(found, "temperatures", [4.0, 9.0])
    assert np.isnan(found.mean.number_density).all()
    np.testing.assert_allclose(grid.mean.number_density, N / 200.0, rtol=0.1)
    assert found.disks.sum() == grid.disks.sum() == rings.disks.sum() == 10 * N
    assert 80.0 > rings.edges[0][-1] > 70.0


def test_species_have_their_own_averages_by_name(tmp_path: Path) -> None:
    """Half of the disks, in one half of the box, are three times as hot, and named."""
    half = N // 2

    def make(rng, disks):
        position = rng.random((disks.n, 2)) * (10.0, 10.0)
        position[half:, 0] += 10.0
        v, spin = thermal(rng, disks, 1.0, 1.0)
        v[half:] *= math.sqrt(3.0)
        return position, v, spin

    species = json.dumps([{"name": "cold", "number": half}, {"name": "hot", "number": N - half}])
    with Trajectory(write_frames(tmp_path / "a.h5", make, parameters={"species": species}, frames=20)) as run:
        found = analysis.profiles(run, "x", 4, frames=range(20))
    assert list(found.species) == ["cold", "hot"]
    cold, hot = found.species.values()
    np.testing.assert_allclose(cold.mean.temperature[:2], 1.0, rtol=0.05)
    np.testing.assert_allclose(hot.mean.temperature[2:], 3.0, rtol=0.05)
    assert np.isnan(hot.mean.temperature[:2]).all()
    np.testing.assert_array_equal(cold.disks + hot.disks, found.disks)
    both = cold.mean.packing_fraction + hot.mean.packing_fraction
    np.testing.assert_allclose(both, found.mean.packing_fraction, rtol=1e-12)
    data = found.to_xarray()
    assert list(data.species.values) == ["cold", "hot"]
    np.testing.assert_array_equal(data.species_temperature[0], cold.mean.temperature)
    assert data["velocity"].dims == ("x", "component")
    assert data["stress_kinetic_error"].dims == ("x", "component", "normal")
    assert "temperature_y [hot] error" in found.columns()


# -- real gases --------------------------------------------------------------------------------------------

CASE = case_text({
    "run.seed": 1, "run.t_end": 20.0,
    "box": {"lengths": [20.0, 16.0], "periodic": [True, False], "material": "coin"},
    "material[0].e_n": 1.0, "material[0].e_t": -1.0, "material[0].mu": 0.3,
    "species": [
        {"name": "small", "number": 120, "material": "coin", "mass": 1.0, "radius": 0.4, "speed_rms": 1.5},
        {"name": "large", "number": 60, "material": "coin", "mass": 2.0, "radius": 0.6, "speed_rms": 1.0},
    ],
    "start": {"positions": "random"},
    "output": {
        "frames": 100, "series": 100, "stress": True, "wall_sums": True, "histories_all": True,
        "fields": ["position", "velocity", "angular_velocity", "collisions"],
    },
})  # fmt: skip
FROM_FILE = {
    "start": {"file": "start.csv"}, "species[0].speed_rms": None, "species[1].speed_rms": None,
}  # fmt: skip


def recorded(run: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Collisional and kinetic part of the mean pressure tensor in the series, (2, 2)."""
    step = np.diff(run.series.time)
    both = [step @ run.series[name][1:] / step.sum() for name in ("stress", "stress_kinetic")]
    return (both[0] - both[1]).reshape(2, 2), both[1].reshape(2, 2)


def test_momentum_to_an_immovable_disk_goes_on_to_its_centre() -> None:
    """Along both radii, as in the recorded virial; the energy, which it does not take, to the contact only."""
    disks = Disks(2, [2.0, np.inf], [0.5, 1.5])
    event = {
        "id": [0], "partner": [1], "position": [[1.0, 1.0]], "normal": [[1.0, 0.0]], "spin_before": [0.0],
        "velocity_before": [[3.0, 0.0]], "velocity_after": [[-1.0, 0.0]], "spin_after": [4.0],
    }  # fmt: skip
    given = SimpleNamespace(disks=disks)
    number, begin, line, p, energy = averages._carried(given, {k: np.array(v) for k, v in event.items()})
    np.testing.assert_array_equal(number, [0, 0])
    np.testing.assert_allclose(begin, [[1.0, 1.0], [1.5, 1.0]])
    np.testing.assert_allclose(line, [[0.5, 0.0], [1.5, 0.0]])
    np.testing.assert_allclose(p, [[8.0, 0.0], [8.0, 0.0]])
    np.testing.assert_allclose(energy, [8.0 - 0.5 * 0.25 * 16.0, 0.0])  # I = 2 * 0.25 / 2


@pytest.mark.full
@pytest.mark.parametrize(("e_n", "e_t", "mu"), [(1.0, -1.0, 0.0), (0.9, -0.5, 0.3)], ids=["elastic", "rough"])
def test_collisions_shared_among_bins_add_up_to_the_recorded_stress(
    written: Written, e_n: float, e_t: float, mu: float
) -> None:
    """The virial that the engine adds up and the pieces of histories: the same to rounding, with walls."""
    with written({"material[0].e_n": e_n, "material[0].e_t": e_t, "material[0].mu": mu}) as run:
        every = range(len(run))
        found = [analysis.profiles(run, axis, 9, frames=every) for axis in ("x", "y")]
        found.append(analysis.mean_fields(run, (4, 7), frames=every))
        collisional, kinetic = recorded(run)
        wall = run.series["walls_momentum_y"][-1]
    for one in found:
        part = (one.mean.stress - one.mean.stress_kinetic).reshape(-1, 2, 2)
        np.testing.assert_allclose(part.mean(axis=0), collisional, rtol=1e-9, atol=1e-12)
    if e_n == 1.0:  # steady: momentum is balanced, P_yy is the pressure on both walls in every strip
        flat = found[2].mean.stress_kinetic.reshape(-1, 2, 2).mean(axis=0)
        np.testing.assert_allclose(flat, kinetic, atol=0.03 * kinetic[0, 0])  # by frames and by rows
        pressure = (wall[0] - wall[1]) / (2.0 * 20.0 * 20.0)
        mean, error = found[1].mean.stress[:, 1, 1], found[1].error.stress[:, 1, 1]
        assert np.abs((mean - pressure) / error).max() < 4.5
        assert np.abs(mean / pressure - 1.0).max() < 0.08


def test_rings_of_a_container_add_up_to_the_recorded_trace(written: Written) -> None:
    """P_rr + P_tt = P_xx + P_yy whatever the directions are: over rings, times their areas, the recorded virial."""
    rough = {"run.t_end": 5.0, "material[0].e_n": 0.9, "material[0].e_t": -0.5}
    box = {"box.lengths": [20.0, 20.0], "box.periodic": [False, False]}
    container = {"shape": "container", "center": [10.0, 10.0], "radius": 9.9, "material": "coin"}
    with written(rough | box | {"wall": [container]}) as run:
        found = analysis.profiles(run, "r", 12, frames=range(len(run)))
        collisional, _ = recorded(run)
    areas = np.pi * np.diff(found.edges[0] ** 2)
    part = np.trace(found.mean.stress - found.mean.stress_kinetic, axis1=1, axis2=2)
    assert areas @ part / areas.sum() == pytest.approx(np.trace(collisional), rel=1e-9)


@pytest.mark.full
def test_a_gas_that_drifts_carries_no_heat(
    written: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In equilibrium q = 0; with the work of the collisional pressure at the drift 6, it would be 6 P_c."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(4)
    place = np.stack(np.meshgrid(np.arange(10) * 2.0 + 1.0, np.arange(8) * 2.0 + 1.0), axis=-1).reshape(-1, 2)
    velocity = rng.normal(size=(80, 2))
    rows = np.column_stack((place, velocity - velocity.mean(axis=0) + (6.0, 0.0), np.zeros(80)))
    np.savetxt("start.csv", rows, delimiter=",", header="x,y,v_x,v_y,spin", comments="")
    numbers = {"species[0].number": 40, "species[1].number": 40}
    with pytest.warns(ifrdem.errors.RunWarning, match="the whole gas drifts"):
        run = written(FROM_FILE | numbers | {"box": {"lengths": [20.0, 16.0]}, "output.wall_sums": None})
    with run:
        found = analysis.profiles(run, "y", 1, frames=range(len(run)))
    mean, error = found.mean, found.error
    np.testing.assert_allclose(mean.velocity[0], (6.0, 0.0), atol=0.3)
    collisional = mean.stress[0, 0, 0] - mean.stress_kinetic[0, 0, 0]
    assert np.all(np.abs(mean.heat_flux[0]) < 4.5 * error.heat_flux[0])
    assert 4.5 * error.heat_flux[0, 0] < 0.3 * 6.0 * collisional


@pytest.mark.full
def test_a_sample_of_disks_is_scaled_to_all(written: Written) -> None:
    """A third of the disks: the recorded stress within some 5 % of their impulses."""
    with written({"output.histories_all": None, "output.histories_sample": 90}) as run:
        found = analysis.profiles(run, "y", 6, frames=range(len(run)))
        collisional, _ = recorded(run)
    part = (found.mean.stress - found.mean.stress_kinetic).mean(axis=0)
    assert np.trace(part) == pytest.approx(np.trace(collisional), rel=0.15)
    assert np.trace(part) != pytest.approx(np.trace(collisional), rel=1e-9)


def test_an_impulse_is_shared_along_the_line_of_centres(
    written: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two disks, of diameters 0.8 and 1.2, collide head-on at x = 7: momentum from 6.6 to 7.6, energy as it is lost.

    Elastic, of mass 1 and 2: the small one at velocity 3, the large one at rest. It gives p = 4 and the energy 4; with
    strips of width 0.5: the part from 6.6 to 7 has 0.4 of p l in [6.5, 7], and so on.
    """
    monkeypatch.chdir(tmp_path)
    start = tmp_path / "start.csv"
    start.write_text("x,y,v_x,v_y,spin\n2.6,8,3,0,0\n7.6,8,0,0,0\n")
    numbers = {"species[0].number": 1, "species[1].number": 1}
    with written(FROM_FILE | numbers | {"run.t_end": 2.0}) as run:
        assert run.series["collisions"][-1] == 1
        found = analysis.profiles(run, "x", 40, frames=range(len(run)))
    area_time = 0.5 * 16.0 * 2.0
    momentum = (found.mean.stress - found.mean.stress_kinetic)[:, 0, 0] * area_time
    expected = np.zeros(40)
    expected[13], expected[14], expected[15] = 4.0 * 0.4, 4.0 * 0.5, 4.0 * 0.1
    np.testing.assert_allclose(momentum, expected, atol=1e-9)
    # As much energy as momentum goes the same way, to the right, less the work u p of the mean velocity of the strip;
    # of the gas, (1 * 3 + 2 * 0) / 3, in the strip where no centre is in any frame.
    heat = (found.mean.heat_flux - found.mean.heat_flux_kinetic)[:, 0] * area_time
    u = found.mean.velocity[:, 0]
    assert abs(u[13]) > 0.1
    assert np.isnan(u[14])
    np.testing.assert_allclose(heat[13:16], (expected * (1.0 - np.nan_to_num(u, nan=1.0)))[13:16], atol=1e-9)


def test_few_disks_of_a_bin_have_no_bias(tmp_path: Path) -> None:
    """Three disks in a strip: m sum (v - u) (v - u) over N - 1, as any covariance of a sample, and P = n T."""
    rng, strips = np.random.default_rng(2), 8
    y = np.repeat(np.arange(strips) + 0.5, 3)
    velocity, disks = rng.normal(size=(len(y), 2)), Disks(len(y), 2.0, 0.5)
    with TrajectoryWriter(tmp_path / "a.h5", disks, Box((4.0, strips)), precision="f64") as file:
        file.write(
            State(np.column_stack((np.tile(np.arange(3) + 0.5, strips), y)), velocity, np.zeros(len(y)))
        )
    with Trajectory(tmp_path / "a.h5") as run:
        found = analysis.profiles(run, "y", strips, span=(0.0, strips)).mean
    expected = 2.0 * np.array([np.cov(one.T, ddof=1) for one in velocity.reshape(strips, 3, 2)])
    np.testing.assert_allclose(found.temperatures, np.diagonal(expected, axis1=1, axis2=2), rtol=1e-12)
    np.testing.assert_allclose(found.stress_kinetic, 3.0 / 4.0 * expected, rtol=1e-12)


def test_collisions_belong_to_their_block_and_stand_for_all_disks_that_move() -> None:
    """Frames at t = 0, 1, 3, 4 in two blocks, which meet at 2; histories of 2 of 4 disks that move, of 5 in all.

    Each collision gives p = 4 along a line of 0.5: a virial of 2, and 4 for all four disks; the energy 4 as much. The
    one at t = 2 is in the first block, one at 0 is before all of them, one of an immovable disk counts nowhere.
    """
    disks = Disks(5, [1.0, 1.0, 1.0, 1.0, np.inf], 0.5)
    time = np.array([0.0, 1.9, 2.0, 2.1, 4.0, 3.0])
    n = len(time)
    event = {
        "time": time, "id": np.array([0, 0, 1, 1, 0, 4]), "partner": np.full(n, 2),
        "position": np.tile([1.2, 1.0], (n, 1)), "normal": np.tile([1.0, 0.0], (n, 1)),
        "velocity_before": np.tile([3.0, 0.0], (n, 1)), "velocity_after": np.tile([-1.0, 0.0], (n, 1)),
        "spin_before": np.zeros(n), "spin_after": np.zeros(n),
    }  # fmt: skip
    given = SimpleNamespace(
        disks=disks, tracked=np.array([0, 1, 4]), tracked_events=(n, -1.0, 3.5),
        read_events=lambda name, stop, start: event[name][start:stop],
    )  # fmt: skip
    ends = averages._block_ends(np.array([0.0, 1.0, 3.0, 4.0]), [[0, 1], [2, 3]])
    np.testing.assert_array_equal(ends, [0.0, 2.0, 4.0])
    bins = Strips(Box((4.0, 3.0)), ("x",), (np.linspace(0.0, 4.0, 3),))
    sums = averages._collisions(given, bins, np.array([6.0, 6.0]), ends, wanted=True)
    np.testing.assert_allclose(
        sums["virial"][:, 0, 0], [2 * 4.0, 1 * 4.0], rtol=1e-12
    )  # the last is after 3.5
    np.testing.assert_allclose(sums["carried"][:, 0, 0], [2 * 4.0, 1 * 4.0], rtol=1e-12)
    assert not sums["virial"][:, 1].any()
    np.testing.assert_allclose(sums["area_time"], [[12.0, 12.0], [9.0, 9.0]])


def test_a_bin_with_a_disk_in_some_frames_is_no_extreme_of_means_over_disks(tmp_path: Path) -> None:
    """A disk is alone in the top strip in 2 of 10 frames: its u_x = 100 and T = 0 are no extremes, its area is."""
    frames = iter(range(10))

    def make(rng, disks):
        position = rng.random((disks.n, 2)) * BOX.lengths * (1.0, 0.75)
        position[:, 1] += 0.2
        v, spin = thermal(rng, disks)
        if next(frames) < 2:
            position[0], v[0] = (10.0, 9.5), (100.0, 0.0)
        return position, v, spin

    with Trajectory(write_frames(tmp_path / "a.h5", make, n=400)) as run:
        found = catalogue.of_profiles(run, range(10), axis="y", bins=5)
    rows = {row.name: row.value for row in found.rows}
    assert found.result.disks[-1] == 2
    assert found.result.mean.velocity[-1, 0] == pytest.approx(100.0)
    assert np.isnan(found.result.mean.theta[-1])
    assert rows["highest u_x"] == found.result.mean.velocity[:-1, 0].max() < 10.0
    assert rows["lowest temperature"] == found.result.mean.temperature[:-1].min() > 1.0
    assert rows["lowest packing fraction"] == found.result.mean.packing_fraction[-1]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"axis": "z"}, "axis = 'z': must be"),
        ({"bins": 0}, "bins = 0: must be"),
        ({"bins": 2.5}, r"bins = 2\.5: must be"),
        ({"axis": "r"}, "axis = r: must have circular walls"),
        ({"frames": [99]}, "frame 99 of"),
        ({"frames": []}, r"frames has shape \(0,\): must be an array of integers, 1 or more"),
        ({"frames": 3}, r"frames has shape \(\): must be an array of integers"),
        ({"span": (3.0, 2.0)}, r"span = \(3, 2\): must be two finite numbers"),
        ({"span": (3.0, math.nextafter(3.0, 4.0)), "bins": 7}, r"span = \(3, 3\): must be wider"),
    ],
)
def test_bad_input_is_refused(tmp_path: Path, given: dict, message: str) -> None:
    def make(rng, disks):
        return (rng.random((disks.n, 2)) * BOX.lengths, *thermal(rng, disks))

    with (
        Trajectory(write_frames(tmp_path / "a.h5", make, frames=2, n=10)) as run,
        pytest.raises(InputError, match=message),
    ):
        analysis.profiles(run, **given)
