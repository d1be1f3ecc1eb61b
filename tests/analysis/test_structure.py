"""Pair correlation, structure factor, clusters and psi_6 of gases with known answers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from support.serial_reference import simulate

from ifrdem import analysis, theory
from ifrdem.analysis import common, structure
from ifrdem.analysis import common as libraries
from ifrdem.errors import InputError
from ifrdem.initial import placement
from ifrdem.model.box import Box
from ifrdem.model.state import Disks, State

SMOOTH = (1.0, -1.0, 0.0, 0.0, 0.0)
UNIT = Box((30.0, 20.0))


def ideal_gas(seed: int, n: int, box: Box = UNIT, count: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).random((count, n, 2)) * box.lengths


def lattice(columns: int, rows: int, spacing: float = 1.0) -> tuple[np.ndarray, Box]:
    """A perfect hexagonal lattice, one row of it along x, in a periodic box; `rows` is even."""
    i, j = np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij")
    step = spacing * np.sqrt(3.0) / 2.0
    position = np.stack(((i + 0.5 * (j % 2) + 0.25) * spacing, (j + 0.5) * step), axis=-1).reshape(-1, 2)
    return position, Box((columns * spacing, rows * step))


@pytest.fixture(scope="module")
def fluid() -> tuple[np.ndarray, Box]:
    """Elastic disks of diameter 1 at packing fraction 0.5: 40 frames, 1.5 collisions a disk apart, after 20."""
    disks = Disks(400, mass=1.0, radius=0.5)
    box = Box.from_packing_fraction(disks.radius, 0.5)
    velocity = placement.maxwellian(disks.mass, temperature=1.0, seed=1)
    state = State(placement.hexagonal_positions(box, disks.radius, seed=1), velocity, np.zeros(400))
    kept = []
    for collisions in [4000, *[300] * 40]:
        state, _ = simulate(disks, box, SMOOTH, state, max_collisions=collisions)
        kept.append(state.position)
    return np.array(kept[1:]), box


def test_pair_correlation_of_an_ideal_gas_is_one_within_its_error() -> None:
    found = analysis.pair_correlation(ideal_gas(1, 1000, count=5), UNIT, r_max=5.0, bins=200)
    deviation = (found.g - 1.0) / found.g_error
    # Counts of pairs in an ideal gas are independent: 200 deviates, normal but for the smallest rings (16 pairs).
    assert np.max(np.abs(deviation)) < 4.5
    assert np.mean(deviation**2) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / 200.0))


@pytest.mark.parametrize("shear_rate", [0.0, 0.4])
def test_pair_correlation_counts_the_pairs_that_a_double_loop_counts(shear_rate: float) -> None:
    box, time = Box((30.0, 20.0), shear_rate=shear_rate), 2.1
    x = ideal_gas(2, 60, box)[0]
    i, j = np.triu_indices(60, 1)
    distance = np.linalg.norm(box.minimum_image(x[j] - x[i], time), axis=1)
    expected, _ = np.histogram(distance, 9, (0.5, 5.0))
    found = analysis.pair_correlation(x, box, r_min=0.5, r_max=5.0, bins=9, time=time)
    np.testing.assert_array_equal(found.pairs, expected)


@pytest.mark.parametrize("shear_rate", [0.0, 0.3])
def test_paths_outside_the_box_have_the_structure_of_what_is_inside(shear_rate: float) -> None:
    """Centres moved by whole boxes, each by others: along y also by what the image above lies further along x."""
    rng, box, time = np.random.default_rng(7), Box((10.0, 8.0), shear_rate=shear_rate), 2.6
    inside, image = rng.random((400, 2)) * box.lengths, rng.integers(-3, 4, size=(400, 2))
    outside = inside + image * box.lengths
    outside[:, 0] += image[:, 1] * shear_rate * 8.0 * time
    found = []
    for x in (inside, outside):
        g = analysis.pair_correlation(x, box, r_max=3.3, r_min=0.35, bins=7, time=time)
        S = analysis.structure_factor(x, box, k_max=9.0, rings=9, time=time)
        joined = analysis.clusters(x, box, radius=0.1, gap=0.05, time=time)
        found.append((g.pairs, S.S, joined.sizes, np.nan_to_num(joined.radius_of_gyration)))
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9)  # of finufft; the others count


def test_walls_do_not_thin_out_the_pair_correlation() -> None:
    """A ring that a wall cuts holds fewer centres: without care g would fall with r."""
    box = Box((30.0, 20.0), periodic=(True, False))
    found = analysis.pair_correlation(ideal_gas(3, 2000, box, 4), box, r_max=4.0, bins=8)
    np.testing.assert_array_less(np.abs(found.g - 1.0), 4.5 * found.g_error)


def test_contact_value_of_a_dense_fluid_is_the_published_one(fluid: tuple[np.ndarray, Box]) -> None:
    """Virial coefficients of N. Clisby and B. M. McCoy, J. Stat. Phys. 122, 15 (2006), doi:10.1007/s10955-005-8080-0.

    Finite systems have g larger or smaller by some 1/n, which is 0.3 %, and the fit's form is good to 1 %.
    """
    position, box = fluid
    found = analysis.contact_value(position, box, radius=0.5)
    expected = theory.contact_value(0.5)
    assert found.error < 0.03 * expected
    assert found.g == pytest.approx(expected, abs=3.0 * found.error + 0.013 * expected)
    assert found.chi_square < found.degrees + 4.0 * np.sqrt(2.0 * found.degrees)


def test_contact_value_refuses_gases_without_one() -> None:
    x = ideal_gas(1, 30)
    with pytest.raises(InputError, match="too few to"):
        analysis.contact_value(x, UNIT, radius=0.05)
    with pytest.raises(InputError, match="radius: must be the same"):
        analysis.contact_value(x, UNIT, radius=[0.5, 0.4])
    with pytest.raises(InputError, match="half the shortest side"):
        analysis.pair_correlation(x, UNIT, r_max=11.0)


@pytest.mark.parametrize("repeated", [False, True])
def test_structure_factor_of_an_ideal_gas_is_one_within_its_error(repeated: bool) -> None:
    """Also where 12 frames all show the same gas, and are worth one."""
    frames = ideal_gas(1, 1000, count=12)
    if repeated:
        frames[:] = frames[0]
    found = analysis.structure_factor(frames, UNIT, k_max=24.0, rings=100)
    used = found.modes > 40  # means of so many are nearly normal, and so is their scatter
    deviation = (found.S[used] - 1.0) / found.S_error[used]
    # 80 rings and more: 1 within 4 standard errors. With errors that are 30 % too small it would be 2.
    assert np.count_nonzero(used) >= 80
    assert np.mean(deviation**2) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / 80.0))
    assert np.max(np.abs(deviation)) < 4.0
    # A mode's S is distributed exponentially: errors themselves are S / sqrt(modes), over sqrt(frames) if independent.
    # Scatter of M modes gives them to within sqrt(2 / M) or sqrt(8 / M) over 2, 1/6 at most for M > 40; of 80, 2 %.
    expected = 1.0 / np.sqrt(found.modes * (1 if repeated else 12))
    assert np.mean(found.S_error[used] / expected[used]) == pytest.approx(1.0, abs=0.06)


@pytest.mark.parametrize("stride", [1, 3])
@pytest.mark.parametrize("shear_rate", [0.0, 0.4])
def test_structure_factor_is_the_sum_that_defines_it(stride: int, shear_rate: float) -> None:
    """Its k are those of the box: the sum does not change when disks are replaced by their images."""
    box, time = Box((30.0, 20.0), shear_rate=shear_rate), 2.1
    x = ideal_gas(4, 50, box)[0]
    k, S = structure.mode_intensities(x, box, (4, 3), stride=stride, time=time)
    rng = np.random.default_rng(1)
    turns = rng.integers(-2, 3, (50, 2))
    image = x + turns * box.lengths
    image[:, 0] += turns[:, 1] * box.image_above(time)
    expected = np.abs(np.exp(-1j * np.einsum("abi,ni->abn", k, image)).sum(axis=-1)) ** 2 / 50
    np.testing.assert_allclose(S, expected, atol=1e-6)  # finufft's 1e-9 of 50^2 / 50
    assert k[4, 4] == pytest.approx((0.0, 2.0 * np.pi * stride / 20.0))


def test_structure_factor_skips_modes_of_large_boxes_without_bias(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(structure, "MOST_MODES", 32)
    found = analysis.structure_factor(ideal_gas(5, 400, count=8), UNIT, k_max=12.0, rings=15)
    assert found.k[-1] > 11.0
    assert np.max(np.abs((found.S - 1.0) / found.S_error)) < 4.0


def test_structure_factor_of_a_lattice_has_its_bragg_peak() -> None:
    """The shortest reciprocal vectors have |k| = 4 pi / (sqrt(3) a) and S = n there; between peaks S = 0."""
    position, box = lattice(16, 18)
    k, S = structure.mode_intensities(position, box, (24, 24))
    size = np.linalg.norm(k, axis=-1)
    peak = np.isclose(size, 4.0 * np.pi / np.sqrt(3.0))
    assert np.count_nonzero(peak) == 6
    np.testing.assert_allclose(S[peak], len(position), rtol=1e-8)
    low = (size > 0.0) & (size < 7.0)
    np.testing.assert_allclose(S[low], 0.0, atol=1e-7)


def small_k(position: np.ndarray, box: Box) -> tuple[float, float]:
    """S in the mean over the two rings of the longest waves, and its standard error."""
    found = analysis.structure_factor(position, box, k_max=1.0, rings=3)
    weight = found.modes[:2] / found.modes[:2].sum()
    return float(weight @ found.S[:2]), float(np.hypot(*(weight * found.S_error[:2])))


@pytest.mark.parametrize("contact", ["virial", "henderson"])
def test_structure_factor_at_small_k_is_the_compressibility(
    contact: str, fluid: tuple[np.ndarray, Box]
) -> None:
    """S(0) = T (d rho / d p) = 1 / (d(phi Z) / d phi), with Z = 1 + 2 phi chi.

    By the virial series, and by D. Henderson, Mol. Phys. 30, 971 (1975): chi = (1 - 7 phi / 16) / (1 - phi)^2.
    """

    def pressure(phi: float) -> float:
        chi = (
            theory.contact_value(phi) if contact == "virial" else (1.0 - 7.0 * phi / 16.0) / (1.0 - phi) ** 2
        )
        return float(phi * (1.0 + 2.0 * phi * chi))

    h = 1e-4
    expected = 2.0 * h / (pressure(0.5 + h) - pressure(0.5 - h))
    found, error = small_k(*fluid)
    # Up to |k| = 0.6 sigma^-1, S has risen by some k^2: 10 %.
    assert found == pytest.approx(expected, abs=3.0 * error + 0.1 * expected)
    assert error < 0.15 * expected


def test_errors_of_long_waves_do_not_fall_with_frames_that_show_the_same_gas(
    fluid: tuple[np.ndarray, Box],
) -> None:
    """Twice as many frames at the same times are worth no more. The longest waves live for some frames."""
    position, box = fluid
    found, error = small_k(position, box)
    again, error_again = small_k(np.repeat(position, 2, axis=0), box)
    assert again == pytest.approx(found, rel=1e-12)
    assert error_again == pytest.approx(error, rel=1e-12)


@pytest.mark.full(keep=1)
@pytest.mark.parametrize("repeated", [1, 8])
def test_errors_of_pairs_do_not_fall_with_frames_that_show_the_same_gas(repeated: int) -> None:
    """Eight copies of an ideal gas are one: the deviations of 30 of them from g = 1 are as large as the errors say.

    By 25 cells the mean square is 24 / 22, less where the larger of two errors is taken; taken as independent, copies
    would have 8. The mean over 570 deviates is known to 6 %.
    """
    squares = []
    for seed in range(30):
        points = np.repeat(ideal_gas(seed, 1000, count=1), repeated, axis=0)
        found = analysis.pair_correlation(points, UNIT, r_max=2.0, bins=20)
        squares.append(((found.g - 1.0) / found.g_error)[1:] ** 2)
    assert 0.7 < np.mean(squares) < 1.3


def test_error_of_a_contact_value_does_not_fall_with_frames_that_show_the_same_gas(
    fluid: tuple[np.ndarray, Box],
) -> None:
    position, box = fluid
    once = analysis.contact_value(position[:1], box, radius=0.5)
    copies = analysis.contact_value(np.repeat(position[:1], 9, axis=0), box, radius=0.5)
    assert copies.g == pytest.approx(once.g, rel=1e-12)
    assert copies.error == pytest.approx(
        once.error, rel=0.3
    )  # 1/3 if copies were independent; 14 % of 25 cells


def test_pair_correlation_of_two_disks_is_that_of_a_single_pair() -> None:
    """An ideal pair is in a ring with the probability ring / area, so that one pair there has g = area / ring.

    N (N - 1) / 2 pairs, not N^2 / 2: with N in place of N - 1 it would be half as much.
    """
    found = analysis.pair_correlation(np.array([[5.0, 5.0], [7.5, 5.0]]), UNIT, r_min=2.0, r_max=3.0, bins=1)
    assert found.pairs[0] == 1.0
    assert found.g[0] == pytest.approx(600.0 / (np.pi * (9.0 - 4.0)), rel=1e-12)
    # Counted from both ends, a pair is one: the error of one is as large as g.
    assert found.g_error[0] == pytest.approx(found.g[0], rel=1e-12)


def test_lattice_is_one_crystal_and_an_ideal_gas_is_none() -> None:
    position, box = lattice(12, 14)
    for kind in ("nearest", "voronoi"):
        found = analysis.hexatic(position, box, neighbours=kind)  # type: ignore[arg-type]
        np.testing.assert_allclose(np.abs(found.psi6), 1.0, atol=1e-5)  # freud's single precision
        assert found.whole == pytest.approx(1.0, abs=1e-5)
    # The direction of bonds of a lattice along x is 0: psi_6 = 1; turned by 90 degrees, exp(6 i 90 degrees) = -1.
    np.testing.assert_allclose(analysis.hexatic(position, box).psi6, 1.0, atol=1e-5)
    turned = analysis.hexatic(position[:, ::-1].copy(), Box(box.lengths[::-1]))
    np.testing.assert_allclose(turned.psi6, -1.0, atol=1e-5)
    gas = analysis.hexatic(ideal_gas(1, 4000)[0], UNIT)
    # psi_6 of 4000 disks in random directions; neighbours share bonds, so that a few of them count as one.
    assert gas.whole < 4.0 * np.sqrt(3.0 / 4000.0)
    assert 0.3 < gas.local < 0.5


def test_order_inside_walls_sees_no_images() -> None:
    position, box = lattice(12, 14)
    walled = analysis.hexatic(position + 5.0, Box((22.0, box.lengths[1] + 10.0), periodic=(False, False)))
    inner = np.all((position > 2.0) & (position < np.array(box.lengths) - 2.0), axis=1)
    np.testing.assert_allclose(np.abs(walled.psi6[inner]), 1.0, atol=1e-5)
    assert np.min(np.abs(walled.psi6)) < 0.9  # the rim


def test_a_row_between_walls_has_its_neighbours_along_it() -> None:
    """Six nearest of a zigzag row by all distances: images across the walls along it or beyond its ends are nearer."""
    row = np.column_stack((np.arange(20) * 1.2 + 1.0, 0.5 + 0.2 * (np.arange(20) % 2)))
    found = analysis.hexatic(row, Box((25.0, 1.2), periodic=(False, False)))
    apart = row - row[:, None]
    near = np.argsort(np.linalg.norm(apart, axis=2), axis=1)[:, 1:7]
    x, y = np.take_along_axis(apart, near[..., None], axis=1).transpose(2, 0, 1)
    np.testing.assert_allclose(found.psi6, np.exp(6j * np.arctan2(y, x)).mean(axis=1), atol=2e-5)


def test_touching_lattice_is_one_cluster_that_spans_the_box() -> None:
    position, box = lattice(12, 14)
    found = analysis.clusters(position, box, radius=0.5, gap=1e-6)
    assert found.sizes.tolist() == [168]
    assert found.spans.tolist() == [True]
    assert np.isnan(found.radius_of_gyration[0])
    alone = analysis.clusters(position * 1.1, Box(tuple(1.1 * np.array(box.lengths))), radius=0.5, gap=0.09)
    assert len(alone.sizes) == 168
    np.testing.assert_array_equal(alone.radius_of_gyration, 0.0)


@pytest.mark.parametrize("shear_rate", [0.0, 0.5])
def test_cluster_across_a_corner_has_the_radius_of_gyration_of_a_rod(shear_rate: float) -> None:
    """Seven disks in a row, a apart, have R_g^2 = a^2 (7^2 - 1) / 12 = 4 a^2, wherever the box cuts them."""
    box, time = Box((20.0, 15.0), shear_rate=shear_rate), 1.3
    row = np.array([19.0, 14.0]) + 1.05 * np.arange(7)[:, None] * np.array([0.6, 0.8])
    pair = np.array([[8.0, 5.0], [8.0, 6.04]])
    found = analysis.clusters(
        box.wrap(np.concatenate((pair, row, [[3.0, 9.0]])), time), box, radius=0.5, gap=0.06, time=time
    )
    assert found.sizes.tolist() == [7, 2, 1]
    np.testing.assert_array_equal(found.label, [1, 1, 0, 0, 0, 0, 0, 0, 0, 2])
    np.testing.assert_allclose(found.radius_of_gyration, [2.1, 0.52, 0.0], rtol=1e-12)
    assert found.largest == 0.7
    assert found.mean_size == pytest.approx((49 + 4 + 1) / 10)


def test_clusters_of_a_mixture_go_by_surfaces() -> None:
    position = np.array([[2.0, 2.0], [3.55, 2.0], [5.0, 2.0]])
    found = analysis.clusters(position, UNIT, radius=[1.0, 0.5, 0.5], gap=0.1)
    assert found.label.tolist() == [0, 0, 1]


def test_neighbours_are_those_of_a_double_loop() -> None:
    for box in (
        UNIT,
        Box((30.0, 20.0), periodic=(True, False)),
        Box.open(),
        Box((30.0, 20.0), shear_rate=1.0),
    ):
        x = ideal_gas(7, 80)[0]
        i, j, vector = common.neighbours(x, box, 4.0, 3.3)
        all_i, all_j = np.triu_indices(80, 1)
        every = box.minimum_image(x[all_j] - x[all_i], 3.3)
        near = np.linalg.norm(every, axis=1) < 4.0
        order = np.lexsort((j, i))
        np.testing.assert_array_equal(i[order], all_i[near])
        np.testing.assert_array_equal(j[order], all_j[near])
        np.testing.assert_allclose(vector[order], every[near], atol=1e-12)


def test_missing_package_is_named_with_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(name: str) -> None:
        raise ModuleNotFoundError(f"No module named '{name}'")

    monkeypatch.setattr(libraries.importlib, "import_module", absent)
    with pytest.raises(
        InputError, match=r"g\(r\) requires the package freud.*pip install 'ifrdem\[analysis\]'"
    ):
        analysis.pair_correlation(ideal_gas(1, 30), UNIT, r_max=5.0)
    with pytest.raises(InputError, match=r"S\(k\) requires the package finufft"):
        analysis.structure_factor(ideal_gas(1, 30), UNIT, k_max=5.0)


@pytest.mark.parametrize("measure", ["pair_correlation", "structure_factor"])
def test_open_and_walled_boxes_are_refused_by_name(measure: str) -> None:
    if measure == "pair_correlation":
        with pytest.raises(InputError, match=r"g\(r\) needs a density"):
            analysis.pair_correlation(ideal_gas(1, 30), Box.open(), r_max=5.0)
    else:
        with pytest.raises(InputError, match="periodic along x and y"):
            analysis.structure_factor(ideal_gas(1, 30), Box((3.0, 2.0), periodic=(True, False)), k_max=9.0)


NONE, SOME = np.zeros((0, 2)), np.random.default_rng(1).random((60, 2)) * 10.0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: analysis.structure_factor([SOME, NONE], (10.0, 10.0), k_max=5.0),
            "position has a frame of 0 disks: must have 1 or more",
        ),
        (
            lambda: analysis.pair_correlation(SOME, (10.0, 10.0), r_max=2.0, others=NONE),
            "others has a frame of 0 disks: must have 1 or more",
        ),
        (
            lambda: analysis.contact_value(SOME, (10.0, 10.0), radius=0.5, others=NONE),
            "others has a frame of 0 disks: must have 1 or more",
        ),
        (
            lambda: analysis.pair_correlation(NONE, (10.0, 10.0), r_max=2.0),
            "position has a frame of 0 disks: must have 2 or more",
        ),
        (
            lambda: analysis.velocity_spectrum(SOME, SOME, (10.0, 10.0), k_max=1e10),
            r"k_max = 1e\+10: must be at most about 1.4e\+03, up to which this box allows 20,000,000 waves",
        ),
        (
            lambda: analysis.coarse_grain(SOME, SOME, box=(10.0, 8.0), cells=(9, 9), width=1e7),
            r"width = 1e\+07: must be at most the longest side, 10",
        ),
        (
            lambda: analysis.coarse_grain(NONE, NONE, box=Box.open(), cells=(9, 9)),
            "position has 0 disks: an open box must have one or more",
        ),
    ],
)
def test_no_disks_and_endless_work_are_refused(call: Callable[[], object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        call()


def test_centres_at_one_place_and_endless_lists_of_pairs_are_refused() -> None:
    """Of 50,000 centres at one place freud overflows its stack, which ended the process without a message."""
    points, box = np.full((1001, 2), 3.0), Box((10.0, 10.0))
    with pytest.raises(InputError, match="more than 1000 disks have their centres at one place"):
        analysis.clusters(points, box, radius=0.1, gap=0.0)
    spread = np.random.default_rng(1).uniform(0.0, 10.0, (30_000, 2))
    with pytest.raises(InputError, match=r"neighbours up to 4.9 of 30000 disks are some 3.4e\+08 pairs"):
        analysis.clusters(spread, box, radius=0.1, gap=4.7)  # n^2 / 2 pi r^2 / A
    with pytest.raises(InputError, match="r_max = 1e-49: must be from 1e-30"):
        analysis.pair_correlation(spread[:9], box, r_max=1e-49)
