"""Displacements, autocorrelations and g(r) of species, and of cooling gases in their own time, with known answers."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import ifrdem
from ifrdem import analysis, theory
from ifrdem.analysis import catalogue, motion, window
from ifrdem.plots import analyses as draw

BOX = ifrdem.Box((50.0, 50.0))


def walk(path: Path, *, cools: bool = False) -> ifrdem.Trajectory:
    """Random walks of 300 disks with steps of +-1 and of 300 with +-3 along x and y, a step a collision.

    If it cools, the n-th step takes 1.1^n, with velocities and sqrt(T) as 1.1^-n.
    """
    rng, n = np.random.default_rng(4), 600
    step = np.repeat([1.0, 3.0], 300)[:, None]
    disks = ifrdem.Disks(n, mass=np.repeat([1.0, 2.0], 300), radius=0.1)
    species = json.dumps([{"name": "slow", "number": 300}, {"name": "fast", "number": 300}])
    x, time = rng.uniform(0.0, 50.0, (n, 2)), 0.0
    with ifrdem.TrajectoryWriter(path, disks, BOX, precision="f64", parameters={"species": species}) as file:
        for i in range(60):
            slower = 1.1**-i if cools else 1.0
            way = step * rng.choice([-1.0, 1.0], (n, 2))
            state = ifrdem.State(
                BOX.wrap(x, 0.0), way * slower, np.zeros(n), time, image=np.floor(x / 50.0).astype(int)
            )
            file.write(state, {"temperature": slower**2, "collisions": i * n // 2})
            x, time = x + way, time + 1.0 / slower
    return ifrdem.Trajectory(path)


def test_line_of_a_free_flight_is_drawn_where_it_is_positive(tmp_path: Path) -> None:
    """The straight line through t^2 is below 0 at small lags, which a logarithmic axis cannot show."""
    disks = ifrdem.Disks(50, mass=1.0, radius=0.1)
    v = np.random.default_rng(1).normal(size=(50, 2))
    with ifrdem.TrajectoryWriter(tmp_path / "a.h5", disks, ifrdem.Box.open(), precision="f64") as file:
        for time in range(40):
            file.write(ifrdem.State(v * time + 100.0 * v, v, np.zeros(50), float(time)))
    axes = Figure().subplots()
    with ifrdem.Trajectory(tmp_path / "a.h5") as run:
        found = motion.of_msd(run, None)
        draw.msd(axes, run, found)
    (line,) = [one for one in axes.lines if "no diffusion" in str(one.get_label())]
    (fit,) = [one.fit for one in found.result.values()]
    t, y = np.asarray(line.get_data())
    assert len(t) > 2
    assert y.min() > 0.0
    assert t[0] > fit.lags[0]


@pytest.mark.parametrize(
    ("frames", "slices"),
    [
        ([0, 1, 2, 3], [slice(0, 4, 1)]),
        ([1, 4, 7], [slice(1, 8, 3)]),
        ([5], [slice(5, 6, 1)]),
        ([0, 1, 2, 10, 20, 30, 31], [slice(0, 3, 1), slice(10, 31, 10), slice(31, 32, 1)]),
    ],
)
def test_frames_are_read_together_where_they_are_evenly_spaced(
    frames: list[int], slices: list[slice], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert list(motion.evenly_spaced(frames)) == slices
    monkeypatch.setattr(motion, "AT_ONCE", 250 * len(frames))
    ids = np.array([3, 4, 200, 260, 599])
    with walk(tmp_path / "a.h5") as run:
        parts = list(motion._parts(run, frames, "velocity", ids))
        expected = [run[i].velocity[ids] for i in frames]
    assert [part.shape[1] for part in parts] == [3, 1, 1]
    np.testing.assert_array_equal(np.concatenate(parts, axis=1), expected)


def test_transforms_of_many_disks_take_little_more_memory_than_their_paths() -> None:
    """Of all disks at a time they took ten times as much."""
    path = np.random.default_rng(1).normal(size=(60, 16_000, 2))
    tracemalloc.start()
    try:
        analysis.mean_square_displacement(np.arange(60.0), path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 2.0 * path.nbytes


LARGER_THAN_MEMORY = """
import resource, sys
import numpy as np
import ifrdem
from ifrdem.analysis import motion

with ifrdem.Trajectory(sys.argv[1]) as run:
    motion.AT_ONCE = 50_000
    motion.of_msd(run, [0, 1, 2, 3])  # with all that is imported on the way
    used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + 30_000_000, -1))
    try:
        np.ones(run.path.stat().st_size // 8)
    except MemoryError:
        print("too large", motion.of_msd(run, None).frames)
"""


@pytest.mark.full
@pytest.mark.skipif(sys.platform != "linux", reason="limits of the address space are those of Linux")
def test_displacements_of_a_file_that_is_larger_than_memory(tmp_path: Path) -> None:
    """64 MB in an address space that has 30 left."""
    rng, disks = np.random.default_rng(1), ifrdem.Disks(10_000, mass=1.0, radius=0.1)
    x, v = rng.uniform(0.0, 50.0, (10_000, 2)), rng.normal(size=(10_000, 2))
    with ifrdem.TrajectoryWriter(tmp_path / "a.h5", disks, BOX, fields=["position", "image"]) as file:
        for time in range(400):
            image = np.floor((x + v * time) / 50.0)
            place = BOX.wrap(x + v * time, 0.0)
            file.write(
                ifrdem.State(place, v, np.zeros(10_000), float(time), image=image.astype(int)),
                {"temperature": 1.0},
            )
    done = subprocess.run(
        [sys.executable, "-c", LARGER_THAN_MEMORY, str(tmp_path / "a.h5")],
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert (tmp_path / "a.h5").stat().st_size > 60_000_000
    assert done.stdout.split() == ["too", "large", "400"]


def test_diffusion_of_each_species(tmp_path: Path) -> None:
    """<|x|^2> = 2 s^2 t of steps +-s along two directions: D = s^2 / 2, 0.5 and 4.5; none of both together."""
    with walk(tmp_path / "a.h5") as run:
        found = motion.of_msd(run, None)
        rows = {row.name: row for row in found.rows}
        for name, D in (("slow", 0.5), ("fast", 4.5)):
            assert rows[f"D of {name}"].value == pytest.approx(D, abs=4.0 * rows[f"D of {name}"].error)
            assert rows[f"D of {name}"].error < 0.1 * D
        assert "D" not in rows
        assert found.tables[""]["msd [fast]"][1] == pytest.approx(18.0, rel=1e-12)
        vacf = motion.of_vacf(run, None)
        assert {row.name: row.value for row in vacf.rows}["<v^2> of fast"] == pytest.approx(18.0)


def test_cooling_gas_diffuses_in_its_own_time(tmp_path: Path) -> None:
    """Steps per collision do not change: D / nu = s^2 / 2 whatever the time between them.

    Speeds are the step over its time, so that the way at the thermal speed in a step, s times (ln u / w) / (1 - w / u)
    of Haff's law, w = u / 1.1, is known; c is not correlated from step to step.
    """
    with walk(tmp_path / "b.h5", cools=True) as run:
        found = motion.of_msd(run, None)
        rows = {row.name: row for row in found.rows}
        assert not any("not stationary" in warning for warning in found.warnings)
        per_step = math.log(1.1) / 0.1
        for name, s in (("slow", 1.0), ("fast", 3.0)):
            row = rows[f"D / nu of {name}"]
            assert row.value == pytest.approx(0.5 * s**2, abs=4.0 * row.error)
            reduced = rows[f"D m nu / T of {name}"]
            assert reduced.value == pytest.approx(row.value / (s * per_step) ** 2, rel=1e-6)
            assert reduced.error == pytest.approx(row.error / (s * per_step) ** 2, rel=1e-6)
            assert row.n_eff == reduced.n_eff == 300
            lengths = found.result[name].free_path / (math.sqrt(0.5 * math.pi) * s)
            assert lengths == pytest.approx(per_step, rel=1e-6)
            table = found.tables[""]
            over = table[f"msd [{name}]"] / table[f"msd / free path^2 [{name}]"]
            np.testing.assert_allclose(over[1:], found.result[name].free_path ** 2, rtol=1e-12)
        vacf = motion.of_vacf(run, None).tables[""]
        assert vacf["vacf [fast]"][0] == pytest.approx(1.0, rel=1e-12)
        assert abs(vacf["vacf [fast]"][1]) < 4.0 * vacf["error [fast]"][1]


def test_way_at_the_thermal_speed_of_a_gas_that_does_not_cool() -> None:
    """Speed 3 over times of 1 and 4, while tau goes from 10 to 12; and half as fast for the second time.

    Between speeds u and w Haff's law, v = u / (1 + a t), has the mean ln(u / w) u w / (u - w).
    """
    when, tau = np.array([0.0, 1.0, 5.0]), np.array([10.0, 11.5, 12.0])
    assert motion.thermal_path(when, tau, np.full(3, 3.0)) == pytest.approx(15.0 / 2.0, rel=1e-12)
    slower = (3.0 + 4.0 * 3.0 * 1.5 * math.log(2.0) / 1.5) / 2.0
    assert motion.thermal_path(when, tau, np.array([3.0, 3.0, 1.5])) == pytest.approx(slower, rel=1e-12)


@pytest.mark.parametrize("drive", window.DRIVES)
def test_a_gas_that_is_driven_or_does_not_collide_has_no_time_of_its_own(tmp_path: Path, drive: str) -> None:
    disks = ifrdem.Disks(4, mass=1.0, radius=0.1)
    for name, given in (("driven", {drive: 0.1}), ("free", {drive: 0.0}), ("still", {drive: 0.0})):
        with ifrdem.TrajectoryWriter(tmp_path / f"{name}.h5", disks, BOX) as file:
            for time in range(6):
                collisions = 2 * time if name != "still" else min(2 * time, 6)
                totals = {"temperature": 1.0, "collisions": collisions, **given}
                file.write(ifrdem.State(np.ones((4, 2)), np.ones((4, 2)), np.zeros(4), float(time)), totals)
        with ifrdem.Trajectory(tmp_path / f"{name}.h5") as run:
            own = motion.own_time(run, range(6))
        if name == "free":
            np.testing.assert_allclose(own, np.arange(6.0))  # each collision is one of both disks
        else:
            assert own is None


def test_self_diffusion_is_that_of_the_rate_of_momentum() -> None:
    """nu_D - zeta / 2 by quadrature of the collision integral of a shifted Maxwellian, over nu.

    With T = m = n sigma g = 1, g_n along a normal at angle a to the shift u e_x is Gaussian of mean u cos a and
    variance 2. Momentum changes by -(1 + e) / 2 g_n per collision, at the rate g_n.
    """
    e, u = 0.7, 1e-4
    angle = (np.arange(400) + 0.5) * 2.0 * np.pi / 400
    g, dg = np.linspace(0.0, 14.0, 20001, retstep=True)

    def mean(power: int, shift: float) -> np.ndarray:
        density = np.exp(-((g - shift * np.cos(angle)[:, None]) ** 2) / 4.0) / math.sqrt(4.0 * np.pi)
        return np.sum(density * g**power, axis=1) * dg

    weight = 2.0 * np.pi / 400
    nu = weight * np.sum(mean(1, 0.0))
    nu_D = weight * np.sum(0.5 * (1.0 + e) * mean(2, u) * np.cos(angle)) / u
    zeta = weight * np.sum(0.25 * (1.0 - e**2) * mean(3, 0.0)) / 2.0
    assert theory.self_diffusion(e) == pytest.approx(nu / (nu_D - 0.5 * zeta), rel=1e-4)


def test_pairs_of_two_species_on_a_lattice() -> None:
    """Centres b are each 1 to the right of one a of a square lattice of side 4: one pair at r = 1, none of a alone."""
    a = 4.0 * np.argwhere(np.ones((10, 10))) + 1.0
    box = ifrdem.Box((40.0, 40.0))
    options: dict[str, Any] = {"r_max": 3.0, "bins": 30}
    found = analysis.pair_correlation(a, box, others=a + np.array([1.0 - 1e-3, 0.0]), **options)
    assert found.pairs[:12].tolist() == [0.0] * 9 + [100.0] + [0.0] * 2
    # 100 pairs over 100 (100 / 1600) 2 pi r dr of an ideal gas.
    assert found.g[9] == pytest.approx(100.0 / (100.0 * 100.0 / 1600.0 * np.pi * (1.0 - 0.81)), rel=1e-9)
    assert not analysis.pair_correlation(a, box, **options).pairs.any()


def test_pairs_of_one_species_split_at_random_are_those_of_all() -> None:
    """g_ab of labels given at random is g; both orders count the same pairs."""
    rng = np.random.default_rng(8)
    position = ifrdem.initial.random_positions(BOX, np.full(1200, 0.5), seed=2)
    own = rng.permutation(1200)[:600]
    rest = np.setdiff1d(np.arange(1200), own)
    options: dict[str, Any] = {"r_max": 5.0, "bins": 20}
    ab = analysis.pair_correlation(position[own], BOX, others=position[rest], **options)
    ba = analysis.pair_correlation(position[rest], BOX, others=position[own], **options)
    np.testing.assert_array_equal(ab.pairs, ba.pairs)
    whole = analysis.pair_correlation(position, BOX, **options)
    parts = [analysis.pair_correlation(position[ids], BOX, **options).pairs for ids in (own, rest)]
    np.testing.assert_array_equal(ab.pairs + parts[0] + parts[1], whole.pairs)
    assert np.all(np.abs(ab.g - whole.g)[5:] < 5.0 * ab.g_error[5:])


def test_contact_value_of_two_species() -> None:
    """g_ab = 1 / (1 - phi) + (9/16) phi / (1 - phi)^2 <s> s_a s_b / (<s^2> s_ab) of diameters s, 1.0776 at phi = 0.05.

    J. T. Jenkins and F. Mancini, J. Appl. Mech. 54, 27 (1987), doi:10.1115/1.3172990. Disks put down at random have
    the same to first order in phi.
    """
    radius = np.repeat([0.5, 1.0], 15_000)
    box = ifrdem.Box.from_packing_fraction(radius, 0.05)
    position = ifrdem.initial.random_positions(box, radius, seed=1)
    found = analysis.contact_value(
        position[:15_000], box, radius=0.5, others=position[15_000:], radius_of_others=1.0
    )
    assert found.error < 0.15
    assert found.g == pytest.approx(1.0776, abs=3.0 * found.error)


def test_contact_value_that_no_parabola_describes_is_marked(tmp_path: Path) -> None:
    """Pairs at r = 1 to 1.05 and 1.2 to 1.25 diameters only, as ln g of a parabola is nowhere."""
    rng, n = np.random.default_rng(1), 6000
    disks, box = ifrdem.Disks(2 * n, mass=1.0, radius=0.5), ifrdem.Box((600.0, 600.0))
    first = rng.uniform(0.0, 600.0, (n, 2))
    r = np.where(rng.random(n) < 0.5, rng.uniform(1.0, 1.05, n), rng.uniform(1.2, 1.25, n))
    r = np.where(rng.random(n) < 0.2, rng.uniform(1.0, 1.25, n), r)
    a = rng.uniform(0.0, 2.0 * np.pi, n)
    second = box.wrap(first + r[:, None] * np.stack((np.cos(a), np.sin(a)), axis=1), 0.0)
    with ifrdem.TrajectoryWriter(tmp_path / "a.h5", disks, box, precision="f64") as file:
        file.write(ifrdem.State(np.concatenate((first, second)), np.zeros((2 * n, 2)), np.zeros(2 * n)))
    with ifrdem.Trajectory(tmp_path / "a.h5") as run:
        found = catalogue.of_pairs(run, None)
    assert any(warning.startswith("g at contact: chi^2 = ") for warning in found.warnings)
    row = next(row for row in found.rows if row.name == "g at contact")
    assert math.isnan(row.error)
