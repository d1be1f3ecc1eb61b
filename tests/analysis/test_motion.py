"""Velocities, displacements, fields, pressure, cooling and impacts of gases with known answers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import beta
from support import serial_reference
from support.serial_reference import simulate

from ifrdem import analysis, laws, theory
from ifrdem.analysis.gas_theory import TheoryGas
from ifrdem.errors import InputError
from ifrdem.initial import placement
from ifrdem.model.box import Box
from ifrdem.model.state import Disks, State
from ifrdem.tools.reprs import brief

SMOOTH = (1.0, -1.0, 0.0, 0.0, 0.0)


def maxwellian(seed: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, 2)), rng.normal(size=n)


def test_gaussian_gas_has_no_sonine_coefficients_within_the_errors_that_theory_gives() -> None:
    """To first order the errors are 1, sqrt(8/3) and sqrt(2) over sqrt(n).

    With u = v^2 / <v^2>, exponential, an influence is (u^2 - 2)/2 - 2 (u - 1), of variance 1; with x = omega / rms it
    is (x^4 - 3)/3 - 2 (x^2 - 1), of variance 32/3 + 8 - 16; the mixed one is (u - 1)(x^2 - 1), of variance 1 x 2.
    """
    n = 200_000
    found = analysis.velocity_distribution(*maxwellian(1, n), mass=3.0, inertia=0.2).sonine
    for value, error, expected in (
        (found.a20, found.a20_error, 1.0),
        (found.a02, found.a02_error, np.sqrt(8.0 / 3.0)),
        (found.a11, found.a11_error, np.sqrt(2.0)),
    ):
        assert error == pytest.approx(expected / np.sqrt(n), rel=0.1)
        assert abs(value) < 3.5 * error
    assert (found.disks, found.frames) == (n, 1)


def test_sonine_coefficients_of_a_mixture_of_two_temperatures_are_exact() -> None:
    """Half of the disks have T = 1 + d and half 1 - d, and T_rot alike: all three are <(1 +- d)^2> - 1 = d^2."""
    n, d = 400_000, 0.4
    v, omega = maxwellian(2, n)
    scale = np.sqrt(np.where(np.arange(n) % 2 == 0, 1.0 + d, 1.0 - d))
    found = analysis.velocity_distribution(v * scale[:, None] + [5.0, -3.0], omega * scale).sonine
    for value, error in (
        (found.a20, found.a20_error),
        (found.a02, found.a02_error),
        (found.a11, found.a11_error),
    ):
        assert value == pytest.approx(d**2, abs=3.5 * error)
        assert error < 0.01


def test_density_follows_the_sonine_expansion_of_an_exactly_sampled_distribution() -> None:
    """Drawn from exp(-c^2) [1 + a2 L_2(c^2)] / pi, L_2(x) = x^2/2 - 2x + 1, by rejection: a20 is a2, component and all.

    L_2 is least at x = 2: 1 - a2 there; a factor of exp(-x/2) / 2 bounds what grows.
    """
    a2, n = 0.15, 400_000
    rng = np.random.default_rng(3)
    x = rng.exponential(2.0, 4 * n)  # density exp(-x/2) / 2
    ratio = np.exp(-x / 2.0) * (1.0 + a2 * (0.5 * x * x - 2.0 * x + 1.0))  # to it, over 2
    assert ratio.max() < 1.2
    x = x[rng.random(len(x)) < ratio / 1.2][:n]
    assert len(x) == n
    angle = rng.random(n) * 2.0 * np.pi
    v = np.sqrt(x)[:, None] * np.stack((np.cos(angle), np.sin(angle)), axis=1)
    found = analysis.velocity_distribution(v, np.zeros(n), bins=40, widest=3.0)
    assert found.sonine.a20 == pytest.approx(a2, abs=3.5 * found.sonine.a20_error)
    assert np.isnan(found.sonine.a02)
    deviation = (found.density - analysis.sonine_density(found.speed, a2)) / found.density_error
    gauss = (found.density - analysis.gaussian(found.speed)) / found.density_error
    # Middles of bins instead of their means cost some 0.3 % of the density, a few errors at most.
    assert np.sqrt(np.mean(deviation**2)) < 3.0
    assert np.sqrt(np.mean(gauss**2)) > 10.0


def test_errors_of_sonine_coefficients_include_the_correlation_of_frames() -> None:
    v, omega = maxwellian(4, 5000)
    once = analysis.velocity_distribution(v, omega).sonine
    again = analysis.velocity_distribution([v] * 10, [omega] * 10).sonine
    assert again.a20 == pytest.approx(once.a20)
    assert again.a20_error == pytest.approx(once.a20_error)
    fresh = [maxwellian(seed, 5000) for seed in range(10)]
    ten = analysis.velocity_distribution([v for v, _ in fresh], [w for _, w in fresh]).sonine
    # 1 / sqrt(n) of 50,000 Gaussian ones; a fourth moment of an influence, which the error has in it, scatters by 5 %.
    assert ten.a20_error == pytest.approx(1.0 / np.sqrt(50_000.0), rel=0.2)


def test_flying_disks_have_a_ballistic_displacement() -> None:
    """<x^2> = <v^2> t^2 exactly, from any origin; velocities stay correlated."""
    t = np.linspace(3.0, 7.0, 41)
    v = np.random.default_rng(1).normal(size=(300, 2))
    path = 1e3 + v * t[:, None, None]
    for origins in ("all", "first"):
        msd = analysis.mean_square_displacement(t, path, origins=origins)  # type: ignore[arg-type]
        np.testing.assert_allclose(
            msd.value, np.mean(np.sum(v**2, axis=1)) * msd.lag**2, rtol=1e-9, atol=1e-9
        )
        same = np.broadcast_to(v, path.shape)
        vacf = analysis.velocity_autocorrelation(t, same, origins=origins)  # type: ignore[arg-type]
        np.testing.assert_allclose(vacf.value, np.mean(np.sum(v**2, axis=1)), rtol=1e-12)
        assert analysis.diffusion_coefficient(msd).exponent == pytest.approx(2.0, abs=1e-9)


def test_displacement_over_all_origins_is_what_a_double_loop_gives() -> None:
    t = np.arange(12.0)
    path = np.cumsum(np.random.default_rng(2).normal(size=(12, 7, 2)), axis=0)
    msd = analysis.mean_square_displacement(t, path)
    vacf = analysis.velocity_autocorrelation(t, path)
    for lag in range(12):
        steps = path[lag:] - path[: 12 - lag]
        assert msd.value[lag] == pytest.approx(np.mean(np.sum(steps**2, axis=2)), abs=1e-12)
        each = np.mean(np.sum(steps**2, axis=2), axis=0)
        assert msd.error[lag] == pytest.approx(np.std(each, ddof=1) / np.sqrt(7.0), abs=1e-12)
        product = np.sum(path[lag:] * path[: 12 - lag], axis=2)
        assert vacf.value[lag] == pytest.approx(np.mean(product), abs=1e-12)


@pytest.mark.parametrize("origins", ["all", "first"])
def test_diffusion_coefficient_of_random_walks_in_a_periodic_box_is_that_of_their_steps(origins: str) -> None:
    """Steps of variance 2 D dt in each direction, through the sides many times; images or shortest steps, in parts."""
    D, dt, box = 0.7, 0.5, Box((20.0, 30.0))
    steps = np.random.default_rng(3).normal(scale=np.sqrt(2.0 * D * dt), size=(201, 2000, 2))
    path = np.cumsum(steps, axis=0)
    image = np.floor(path / box.lengths).astype(np.int32)
    inside = path - image * box.lengths
    t = dt * np.arange(201)
    by_image = analysis.unwrap(inside, box, image=image, times=t)
    shortest = analysis.unwrap(inside, box)
    np.testing.assert_allclose(by_image, path, atol=1e-11)
    np.testing.assert_allclose(shortest - shortest[0], path - path[0], atol=1e-11)
    parts = (by_image[:, first : first + 500] for first in range(0, 2000, 500))
    msd = analysis.mean_square_displacement(t, parts, origins=origins)  # type: ignore[arg-type]
    found = analysis.diffusion_coefficient(msd)
    assert found.error < 0.06 * D
    assert pytest.approx(D, abs=3.5 * found.error) == found.D
    assert found.exponent == pytest.approx(1.0, abs=0.15)


def test_error_of_a_diffusion_coefficient_covers_the_truth() -> None:
    """40 runs of 100 walks each: the mean square of deviation over error is 1 +- sqrt(2 / 40)."""
    t = np.arange(60.0)
    pulls = []
    for seed in range(40):
        path = np.cumsum(np.random.default_rng(seed).normal(size=(60, 100, 2)), axis=0)
        found = analysis.diffusion_coefficient(analysis.mean_square_displacement(t, path))
        pulls.append((found.D - 0.5) / found.error)
    assert np.mean(np.square(pulls)) == pytest.approx(1.0, abs=3.5 * np.sqrt(2.0 / 40.0))


def test_paths_that_are_too_coarse_are_refused_and_images_are_asked_for() -> None:
    box = Box((10.0, 10.0))
    far = np.random.default_rng(1).random((20, 50, 2)) * 10.0
    with pytest.raises(InputError, match=r'"image" into output\.fields'):
        analysis.unwrap(far, box)
    with pytest.raises(InputError, match="sheared box need images"):
        analysis.unwrap(far, Box((10.0, 10.0), shear_rate=1.0))
    with pytest.raises(InputError, match="not evenly spaced"):
        analysis.mean_square_displacement(np.geomspace(1.0, 9.0, 20), far)
    with pytest.raises(InputError, match=r"did you mean 'first'"):
        analysis.mean_square_displacement(np.arange(20.0), far, origins="frist")  # type: ignore[arg-type]


@pytest.mark.parametrize("width", [0.0, 4.0])
def test_shear_wave_has_its_thermal_temperature_and_that_of_the_flow_within_a_cell(width: float) -> None:
    """v = A sin(q y) x^ + thermal, T = 1, m = 2. Averaging over a place takes from the wave and gives to T.

    A Gaussian of width w leaves A exp(-q^2 w^2 / 2) of the wave, and T gets m (<u^2> - <u>^2) / 2 with
    <u^2> = A^2 (1 - exp(-2 q^2 w^2) cos(2 q y)) / 2. A cell of height h leaves the mean and the variance of the sine in
    it: sin(q h / 2) / (q h / 2) of the wave, and <u^2> = A^2 (1 - cos(2 q y) sin(q h) / (q h)) / 2.
    """
    n, m, A, box = 200_000, 2.0, 3.0, Box((60.0, 80.0))
    rng = np.random.default_rng(5)
    x = rng.random((n, 2)) * box.lengths
    q = 2.0 * np.pi / 80.0
    v = rng.normal(scale=np.sqrt(1.0 / m), size=(n, 2))
    v[:, 0] += A * np.sin(q * x[:, 1])
    cells = (30, 40) if width else (4, 16)
    found = analysis.coarse_grain(
        x, v, rng.normal(size=n), box=box, cells=cells, mass=m, inertia=0.7, radius=0.05, width=width
    )
    y, h = found.y[None, :], 80.0 / cells[1]
    if width:
        keep, squares = np.exp(-0.5 * (q * width) ** 2), np.exp(-2.0 * (q * width) ** 2)
    else:
        keep, squares = np.sinc(q * h / (2.0 * np.pi)), np.sinc(q * h / np.pi)
    u = A * keep * np.sin(q * y)
    T = 1.0 + 0.5 * m * (0.5 * A**2 * (1.0 - squares * np.cos(2.0 * q * y)) - u**2)
    # A cell has 3125 disks, a Gaussian of width 4 counts as 4 pi 4^2 41.7 = 8400 of them: errors of u are
    # sqrt(T / m N), of T they are T / sqrt(N).
    number = 8400.0 if width else 3125.0
    assert np.max(np.abs(found.velocity[..., 0] - u) / np.sqrt(T / (m * number))) < 5.0
    assert np.max(np.abs(found.velocity[..., 1]) * np.sqrt(m * number)) < 5.0
    assert np.max(np.abs(found.temperature - T) / T) < 5.0 / np.sqrt(number) + 0.002
    np.testing.assert_allclose(found.rotational_temperature, 0.7, rtol=5.0 * np.sqrt(2.0 / number))
    np.testing.assert_allclose(found.number.mean(), n / box.area, rtol=1e-9)
    np.testing.assert_allclose(found.packing_fraction, found.number * np.pi * 0.05**2, rtol=1e-12)


@pytest.mark.parametrize("width", [0.0, 0.8])
def test_temperature_of_few_disks_in_a_cell_is_without_bias(width: float) -> None:
    """Two disks a cell on average, u from themselves: without the correction T would be 0.4 to 0.5 too small."""
    n, box = 80_000, Box((200.0, 200.0))
    rng = np.random.default_rng(6)
    mass = rng.choice([0.5, 2.0], n)
    v = rng.normal(size=(n, 2)) / np.sqrt(mass)[:, None]
    found = analysis.coarse_grain(
        rng.random((n, 2)) * box.lengths, v, box=box, cells=(200, 200), mass=mass, width=width
    )
    weight = np.where(np.isfinite(found.temperature), found.number, 0.0)
    if width:  # by its degrees of freedom, so that cells with few of them do not scatter it
        weight = np.where(found.number > 1.0, weight, 0.0)
    T = np.average(np.nan_to_num(found.temperature), weights=weight)
    assert pytest.approx(1.0, abs=0.02) == T


def test_fields_of_paths_outside_the_box_are_those_of_what_is_inside() -> None:
    """Centres moved by whole boxes, each by others, and half a unit beyond the sides by hand; walls hold the rest."""
    rng, box = np.random.default_rng(7), Box((10.0, 8.0))
    x, v = rng.random((400, 2)) * box.lengths, rng.normal(size=(400, 2))
    outside = x + rng.integers(-3, 4, size=(400, 2)) * box.lengths
    inner, outer = (analysis.coarse_grain(each, v, box=box, cells=(5, 4)) for each in (x, outside))
    np.testing.assert_array_equal(inner.number, outer.number)
    np.testing.assert_allclose(inner.velocity, outer.velocity, rtol=1e-12)
    beyond = analysis.coarse_grain(
        np.array([[10.5, 1.0], [-0.5, 7.0]]), np.ones((2, 2)), box=box, cells=(2, 2)
    )
    assert (beyond.number * 20.0).tolist() == [[1.0, 0.0], [0.0, 1.0]]
    sheared = Box((10.0, 8.0), shear_rate=0.3)
    with pytest.raises(InputError, match=r"y from -0\.5 to 7 must lie in the sheared box"):
        analysis.coarse_grain(np.array([[1.0, -0.5], [1.0, 7.0]]), np.ones((2, 2)), box=sheared, cells=(2, 2))


def test_fields_next_to_walls_are_not_thinned() -> None:
    box = Box((50.0, 50.0), periodic=(False, True))
    x = np.random.default_rng(7).random((100_000, 2)) * 50.0
    found = analysis.coarse_grain(x, np.zeros_like(x), box=box, cells=(50, 50), width=2.0)
    np.testing.assert_allclose(
        found.number, 40.0, rtol=0.12
    )  # 4.5 times 1 / sqrt(4 pi 2^2 40 / 2) at the wall


def elastic_gas(monkeypatch: pytest.MonkeyPatch, e_n: float, seed: int) -> dict[str, np.ndarray | float]:
    """Collisions of 300 disks at packing fraction 0.4 by the serial reference: what a history of all would hold."""
    rows: list[tuple[float, float, float, float, float, float]] = []

    class Recording(serial_reference._Gas):
        def collide(self, i: int, j: int, sx: int, sy: int, now: float) -> None:
            old = (self.vx[j], self.vy[j])
            vi, vj = (self.vx[i], self.vy[i]), old
            super().collide(i, j, sx, sy, now)
            rx, ry = self.separation(i, j, sx, sy, now)
            g = (vi[0] - vj[0], vi[1] - vj[1])
            d = np.hypot(rx, ry)
            n = (rx / d, ry / d)
            J = (self.vx[j] - old[0], self.vy[j] - old[1])  # of mass 1
            psi = np.arctan2(abs(g[1] * n[0] - g[0] * n[1]), g[0] * n[0] + g[1] * n[1])
            rows.append((now, *n, J[0] * n[0] + J[1] * n[1], J[1] * n[0] - J[0] * n[1], psi))

    disks = Disks(300, mass=1.0, radius=0.5)
    box = Box.from_packing_fraction(disks.radius, 0.4)
    velocity = placement.maxwellian(disks.mass, temperature=1.0, seed=seed)
    start = State(placement.hexagonal_positions(box, disks.radius, seed=seed), velocity, np.zeros(300))
    start, _ = simulate(disks, box, SMOOTH, start, max_collisions=4000)
    monkeypatch.setattr(serial_reference, "_Gas", Recording)
    end, _ = simulate(disks, box, (e_n, -1.0, 0.0, 0.0, 0.0), start, max_collisions=12_000)
    time, *rest = np.array(rows).T
    T = float(np.sum(start.velocity**2) / 600.0)
    return {"time": time, "rest": np.array(rest), "span": (start.time, end.time), "area": box.area, "T": T}


def test_pressure_of_elastic_disks_is_the_published_one_by_impulses_and_by_the_rate(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Virial coefficients of doi:10.1007/s10955-005-8080-0; finite systems are off by some 1/n."""
    gas = elastic_gas(monkeypatch, 1.0, seed=1)
    time, rest, span = gas["time"], gas["rest"], gas["span"]
    twice = np.concatenate((time, time))
    n, J = rest[:2].T, rest[2:4].T
    found = analysis.pressure_from_impulses(
        twice,
        np.concatenate((n, -n)),
        np.concatenate((J, J)),  # P_n and P_t are the same from the partner's side
        np.ones(len(twice)),
        span=span,  # type: ignore[arg-type]
        area=gas["area"],  # type: ignore[arg-type]
        disks=300,
        tracked=300,
        temperature=gas["T"],  # type: ignore[arg-type]
    )
    chi = theory.contact_value(0.4)
    expected = analysis.compressibility(0.4, chi)
    relative = found.error / found.collisional
    assert relative < 0.02
    assert pytest.approx(expected, abs=(expected - 1.0) * (3.5 * relative + 1.0 / 300.0)) == found.Z
    assert found.total == pytest.approx(found.kinetic * found.Z)
    off = found.collisional_tensor[0, 1] / found.collisional
    assert abs(off) < 0.1
    # Impulses pass no angular momentum: the tensor is symmetric.
    np.testing.assert_allclose(found.collisional_tensor, found.collisional_tensor.T, rtol=1e-9)
    rate = 2.0 * len(time) / 300.0 / (span[1] - span[0])  # type: ignore[index]
    T: float = gas["T"]  # type: ignore[assignment]
    by_rate = analysis.contact_from_rate(rate, packing_fraction=0.4, temperature=T, mass=1.0, radius=0.5)
    assert by_rate == pytest.approx(chi, rel=3.5 * relative + 1.0 / 300.0)


def test_pressure_from_a_few_tracked_disks_is_that_of_all_in_the_mean() -> None:
    """Impulses that all are alike, on 10 of 40 disks: the sum over them times 4, half of it each."""
    found = analysis.pressure_from_impulses(
        np.linspace(0.0, 2.0, 50),
        np.tile([0.6, 0.8], (50, 1)),
        np.tile([3.0, 0.4], (50, 1)),
        np.full(50, 1.5),
        span=(0.0, 2.0),
        area=10.0,
        disks=40,
        tracked=10,
        temperature=1.0,
    )
    # 50 x 4 / 2 collisions x 1.5 x 3 / (2 A t) = 11.25
    assert found.collisional == pytest.approx(11.25)
    assert found.kinetic == pytest.approx(4.0)
    # P_yx - P_xy is what collisions pass of angular momentum, n x J = P_t: 50 x 4 / 2 collisions x 1.5 x 0.4 / (A t).
    difference = found.collisional_tensor[1, 0] - found.collisional_tensor[0, 1]
    assert difference == pytest.approx(100 * 1.5 * 0.4 / 20.0)


def test_gas_in_molecular_chaos_meets_at_angles_with_the_density_cos_psi(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    psi = elastic_gas(monkeypatch, 1.0, seed=2)["rest"][4]  # type: ignore[index]
    found = analysis.impacts(psi, np.where(np.arange(len(psi)) % 4 == 0, 1, 2))
    assert found.p_value > 1e-3
    assert found.mean_b == pytest.approx(0.5, abs=3.5 * np.sqrt(1.0 / 12.0 / len(psi)))
    deviation = (found.density - np.cos(found.psi)) / found.density_error
    assert np.mean(deviation**2) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / 45.0))
    assert found.regimes["sliding"][0] == pytest.approx(0.25)
    # The standard deviation of the probability by Jeffreys' prior, 1.5 / n off sqrt(p (1 - p) / n).
    count = 0.75 * len(psi)
    expected = beta(count + 0.5, len(psi) - count + 0.5).std()
    assert found.regimes["sticking"][1] == pytest.approx(expected, rel=1e-9)


@pytest.mark.full
def test_few_collisions_get_few_bins_and_errors_that_cover_empty_ones() -> None:
    """Deviations over errors of 200 gases in molecular chaos: their mean square is about 1 whatever the number."""
    for n, bins in ((60, 9), (800, 20), (20_000, 45)):
        squares, lowest = [], np.inf
        for seed in range(200):
            found = analysis.impacts(np.arcsin(np.random.default_rng(seed).random(n)))
            assert len(found.psi) == bins
            edges = np.linspace(0.0, np.pi / 2.0, bins + 1)
            exact = np.diff(np.sin(edges)) / np.diff(edges)
            squares.append(np.mean(((found.density - exact) / found.density_error) ** 2))
            lowest = min(lowest, float(found.density_error.min()))
        assert 0.7 < np.mean(squares) < 1.4
        assert lowest > 0.0
    assert len(analysis.impacts(np.full(100, 0.3), bins=12).psi) == 12


def test_uniform_angles_are_distinguished() -> None:
    found = analysis.impacts(np.random.default_rng(1).random(2000) * np.pi / 2.0)
    assert found.p_value < 1e-6
    with pytest.raises(InputError, match="from 0 to pi / 2"):
        analysis.impacts([0.5 * np.pi * (1.0 + 1e-11)])
    # Of a grazing collision, an angle of 90 degrees as it is rounded.
    assert analysis.impacts([np.nextafter(0.5 * np.pi, 2.0)]).collisions == 1


def noise(seed: int, n: int, memory: float) -> np.ndarray:
    """Gaussian noise of variance 1 with correlation memory^|lag|: its time is 1/2 + memory / (1 - memory)."""
    rng = np.random.default_rng(seed)
    x = np.empty(n)
    x[0] = rng.normal()
    for i in range(1, n):
        x[i] = memory * x[i - 1] + np.sqrt(1.0 - memory**2) * rng.normal()
    return x


def test_correlation_time_of_a_markov_chain_is_known() -> None:
    for memory, expected in ((0.0, 0.5), (0.8, 4.5)):
        found = analysis.correlation_time(noise(1, 40_000, memory))
        assert found == pytest.approx(expected, rel=0.12)


def test_fit_of_haffs_law_recovers_its_parameters_with_errors_that_include_correlations() -> None:
    """60 runs with correlated noise: deviations over errors scatter by about 1, and would by 3 if taken independent."""
    t = np.linspace(2.0, 40.0, 400)
    exact = 3.0 / (1.0 + (t - 2.0) / 5.0) ** 2
    pulls, naive = [], []
    for seed in range(60):
        found = analysis.haff_fit(t, exact * np.exp(0.05 * noise(seed, 400, 0.8)))
        pulls += [(found.T0 - 3.0) / found.T0_error, (found.t_H - 5.0) / found.t_H_error]
        naive += [pulls[-1] * np.sqrt(2.0 * found.correlation_time)]
    assert 0.6 < np.sqrt(np.mean(np.square(pulls))) < 1.5
    assert np.sqrt(np.mean(np.square(naive))) > 2.0
    clean = analysis.haff_fit(t, exact)
    assert (clean.T0, clean.t_H) == pytest.approx((3.0, 5.0), rel=1e-8)
    assert clean.times == (2.0, 40.0)
    with pytest.raises(InputError, match="does not cool"):
        analysis.haff_fit(t, 1.0 + t)


def test_haff_fit_finds_the_time_that_theory_gives_smooth_disks() -> None:
    """dT/dt = -(nu / 2)(1 - e_n^2) T, nu ~ sqrt(T): T = T0 (1 + t / t_H)^-2 with t_H = 4 / ((1 - e_n^2) nu_0)."""
    from ifrdem import IFRLaw

    law = IFRLaw(e_n=0.8, e_t=-1.0, mu=0.0)
    t = np.linspace(0.0, 60.0, 50)
    T, _, _ = theory.cooling(law, 1.0, 0.5, 2.0, 0.2, 1.5, 0.0, t)
    nu = theory.collision_rate(0.2, 1.5, 1.0, 0.5)
    assert analysis.haff_fit(t, T).t_H == pytest.approx(4.0 / ((1.0 - 0.64) * nu), rel=1e-5)


def test_fit_of_the_ratio_finds_end_and_lag() -> None:
    x = np.linspace(0.0, 20.0, 120)
    exact = 0.9 + (0.1 - 0.9) * np.exp(-x / 3.0)
    found = analysis.ratio_fit(x, exact)
    assert (found.theta_0, found.theta_end, found.lag) == pytest.approx((0.1, 0.9, 3.0), rel=1e-7)
    pulls = []
    for seed in range(40):
        fit = analysis.ratio_fit(x, exact + 0.02 * noise(seed, 120, 0.5))
        pulls += [(fit.theta_end - 0.9) / fit.theta_end_error, (fit.lag - 3.0) / fit.lag_error]
    assert 0.7 < np.sqrt(np.mean(np.square(pulls))) < 1.5


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
def test_a_ratio_that_begins_at_its_end_by_chance_has_the_lag_of_least_squares_in_any_unit(
    unit: float,
) -> None:
    """No value is nearer to the end than the first one, so that none is a first guess of the lag.

    At a given lag the law is linear in its other two parameters: of a fine grid of lags the best is the answer.
    """
    x = np.linspace(0.0, 20.0, 201)
    theta = 0.6 - 0.6 * np.exp(-x / 3.0)
    theta[0] = theta[-40:].mean()
    grid = np.geomspace(1e-3, 100.0, 2001)
    laws = [np.column_stack((np.ones_like(x), np.exp(-x / lag))) for lag in grid]
    left = [np.sum((law @ np.linalg.lstsq(law, theta, rcond=None)[0] - theta) ** 2) for law in laws]
    assert analysis.ratio_fit(unit * x, theta).lag / unit == pytest.approx(grid[np.argmin(left)], rel=0.006)


def test_swapped_times_and_paths_are_refused() -> None:
    times, paths = np.arange(5.0), np.zeros((5, 7, 2))
    for function, name in (
        (analysis.mean_square_displacement, "paths"),
        (analysis.velocity_autocorrelation, "velocity"),
    ):
        with pytest.raises(InputError, match=r"times has shape \(5, 7, 2\): must be .* of shape \(frames,\)"):
            function(paths, times)
        with pytest.raises(InputError, match=r"times = <generator .*: must be"):
            function((paths for _ in range(2)), times)
        with pytest.raises(InputError, match=r"times has shape \(1,\): must have 2 frames or more"):
            function(times[:1], paths[:1])
        with pytest.raises(InputError, match="from 4 to 0: must increase"):
            function(times[::-1], paths)
        with pytest.raises(InputError, match=rf"{name} has shape \(4, 7, 2\): must have 5 frames"):
            function(times, paths[:4])
        with pytest.raises(InputError, match=rf"{name} has shape \(5,\): must be .* \(frames, n, d\)"):
            function(times, times)


@pytest.mark.parametrize("name", analysis.__all__)
def test_public_names_are_the_names_in_messages(name: str) -> None:
    assert getattr(analysis, name).__name__ == name


def test_results_have_a_short_repr() -> None:
    paths = np.random.default_rng(1).random((50, 9, 2))
    lag = analysis.mean_square_displacement(np.arange(50.0), paths, origins="first")
    assert repr(lag).startswith("<Correlation: lag (50,) from 0 to 49, value (50,) from 0 to ")
    assert repr(lag).endswith("components 2, disks 9, origins 'first'>")
    hits = analysis.impacts(np.linspace(0.0, 1.5, 400))
    assert repr(hits).startswith("<Impacts: psi (10,) from ")
    near = analysis.clusters(np.array([[1.0, 1.0], [1.5, 1.0], [3.0, 3.0]]), (9.0, 9.0), radius=0.2, gap=0.2)
    assert repr(near).startswith("<Clusters: label (3,) from 0 to 1, sizes (2,) from 1 to 2, ")
    assert repr(near).endswith("spans (2,) with 0 true, gap 0.2>")
    assert brief(np.array([np.nan, 2.0])) == "(2,) all 2, some nan"
    assert brief(np.array([np.nan])) == "(1,) of nan"
    assert brief(np.zeros((0, 2))) == "(0, 2)"
    assert brief(np.array([3.0 + 4.0j])) == "(1,) sizes all 5"


def test_frames_that_do_not_match_are_refused() -> None:
    v, omega = maxwellian(1, 10)
    with pytest.raises(InputError, match="same number of frames"):
        analysis.velocity_distribution([v, v], [omega])
    with pytest.raises(InputError, match="spin 9"):
        analysis.velocity_distribution(v, omega[:9])
    with pytest.raises(InputError, match="a time for each frame"):
        analysis.structure_factor([v, v], (9.0, 9.0), k_max=3.0, time=[0.0])
    with pytest.raises(InputError, match=r"position\[0, 0\] = nan: must be"):
        analysis.structure_factor(v * np.nan, (9.0, 9.0), k_max=3.0)
    with pytest.raises(InputError, match="must have that of position"):
        analysis.unwrap([v, v], (9.0, 9.0), image=np.zeros((2, 9, 2), dtype=np.int32))


@pytest.mark.parametrize(
    ("law", "e_n"),
    [
        (laws.smooth_disks(0.8), 0.8),
        (laws.Walton(e_n=0.8, beta_0=0.3, mu=0.0), 0.8),
        (laws.rough_disks(0.8, beta=0.5), None),  # mu = 0, yet each collision changes the spins
        (laws.Viscoelastic(A=0.01, Y=1.0), None),
    ],
    ids=["smooth", "without friction", "rough", "of the speed"],
)
def test_theory_of_smooth_disks_is_for_smooth_disks_only(law: laws.CollisionLaw, e_n: float | None) -> None:
    disks, zero = Disks(2, mass=1.0, radius=0.5), np.zeros(2, dtype=np.int64)
    gas = TheoryGas(disks, [[law]], 0.1, T0=np.ones(1), T_rot0=np.zeros(1), forces=[], kind=zero)
    assert gas.smooth_restitution == e_n
