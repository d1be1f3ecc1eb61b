"""Needs of a case on ranks of MPI, estimated without a start."""

from __future__ import annotations

import contextlib
import functools
import math
import pickle
import tracemalloc

import numpy as np
import pytest
from support.cases import case_text

from ifrdem.case import file, report, starts, summary
from ifrdem.case.estimate import RankPlan, RunEstimate, strip_bytes
from ifrdem.case.gas import CaseGas
from ifrdem.errors import InputError
from ifrdem.initial import placement
from ifrdem.kernels import columns
from ifrdem.mpi import distribution
from ifrdem.simulation import backend
from ifrdem.simulation.start import checks
from ifrdem.tools import seeds

CASE = case_text({
    "run.collisions_per_disk": 10.0, "run.t_end": None, "box.packing_fraction": 0.3,
    "material[0].name": "a", "material[0].e_n": 0.95, "material[0].e_t": -0.9, "material[0].mu": 0.1,
    "species": [
        {"name": "light", "material": "a", "number": 600000000, "mass": 1.0, "radius": 0.5, "speed_rms": 1.0},
        {"name": "heavy", "material": "a", "number": 400000000, "mass": 2.0, "radius": 0.5, "speed_rms": 1.0},
    ],
    "start": {"positions": "hexagonal"}, "output": {"frames": 10},
})  # fmt: skip


def case_of(*changes: str) -> file.CaseFile:
    return file.of_text(CASE, file.Path("gas.toml"), changes)


@functools.cache
def large() -> tuple[CaseGas, file.CaseFile, RunEstimate, int]:
    """1e9 disks, and the memory that it took to look at them [bytes]."""
    tracemalloc.start()
    found = case_of()
    gas = found.gas
    estimate = RunEstimate.of(gas)
    report.report(gas, estimate)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return gas, found, estimate, peak


def test_no_array_of_all_disks_goes_to_other_ranks() -> None:
    """Arrays that were computed of a gas stay here: 2000 disks have 5 columns of 8 bytes, 80 kB."""
    gas = case_of("species[0].number=1000", "species[1].number=1000").gas
    sent = len(pickle.dumps(gas))
    assert gas.disks.n == 2000
    assert len(pickle.dumps(gas)) == sent < 20_000


def test_a_case_of_1e9_disks_is_checked_without_an_array_of_them() -> None:
    gas, _, estimate, peak = large()
    assert gas.n == 10**9
    assert peak < 30e6  # an array of a byte for each disk would be 1e9
    # Sides by hand: pi R^2 N / phi = L^2.
    assert gas.box.lengths[0] == pytest.approx(math.sqrt(1e9 * math.pi * 0.25 / 0.3), rel=1e-9)
    assert estimate.collisions == 5e9


@pytest.mark.full
@pytest.mark.parametrize("distribution", ['"uniform",low=0.4,high=0.6', '"gaussian",mean=0.5,deviation=0.05'])
def test_a_case_with_a_radius_for_each_disk_is_checked_without_an_array_of_them(distribution: str) -> None:
    """8e6 disks: an array of a number for each would be 64 MB; one of a block is 2 MB."""
    drawn = f"species[0].radii={{distribution={distribution}}}"
    tracemalloc.start()
    found = case_of("species[0].number=8000000", "species[1].number=1000", "species[0].radius=", drawn)
    gas = found.gas
    estimate = RunEstimate.of(gas)
    report.report(gas, estimate)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 45e6
    assert len(gas.kinds.mass) < 30
    assert gas.kinds.mean_radius == pytest.approx(0.5, rel=2e-4)  # 0.06 / sqrt(8e6), five times
    # A lattice of so many disks, and a plan: 80 bytes more for each disk and those in halos than of equal ones.
    plan, side = RankPlan.of(gas, estimate, 8), math.sqrt(8_001_000 / 8 * math.pi / 4.0 / 0.3)
    with_halos = (side + 36.0) ** 2 / side**2
    assert plan.memory == pytest.approx(280e6 + 780 * 8_001_000 / 8 * with_halos + 450 * 8e6 / 5000, rel=1e-4)


def test_the_plan_of_1e9_disks_is_its_arithmetic() -> None:
    """1000 ranks: blocks of 1e6 disks, 1618 diameters wide (sqrt(1e6 pi/4/0.3)), with 18 more on each side."""
    gas, _, estimate, _ = large()
    plan = RankPlan.of(gas, estimate, 1000)
    with_halos = (1618.02 + 36.0) ** 2 / 1618.02**2
    assert plan.disks == 1e6
    assert plan.memory == pytest.approx(280e6 + 700 * 1e6 * with_halos + 450 * 1e9 / 5000, rel=1e-5)
    # Frames of 32 bytes a disk, constants of 28.
    assert plan.file == pytest.approx(1.02 * (11 * 32 + 28) * 1e6, rel=0.01)
    # 10/2 collisions of each disk, 11 frames of 0.6; 0.55 us a collision at phi = 0.3, and 1.75 times that in tiles.
    assert plan.seconds == pytest.approx(1e6 * (5.0 + 11 * 0.6) * 0.55e-6 * 1.75 * with_halos, rel=1e-4)
    assert report.planned_ranks(10**9, columns.most_disks()) == [12, 63, 250, 1000]
    assert report.planned_ranks(1_100_000, columns.most_disks()) == [2]
    assert "on 1000 ranks of MPI, each" in (text := report.report(gas, estimate).text)
    assert "1e+06 disks, 1.1 GB of memory, 388 MB of files" in text


def test_strips_that_a_rank_places_at_random_count(monkeypatch: pytest.MonkeyPatch) -> None:
    """1.1e6 disks make 4 strips of 275,000: of 16 ranks, which have 68,750 each, four place one."""
    changes = "species[0].number=700000", "species[1].number=400000", "start.positions=random"
    found = case_of(*changes)
    gas = found.gas
    assert starts.strips(gas) == 4
    one = 275_000 * (100 + 300)
    assert [strip_bytes(gas, ranks) for ranks in (2, 3, 4, 16)] == pytest.approx(
        [one + 275_000 * 100, one + 275_000 * 100, one, one], rel=1e-12
    )
    estimate = RunEstimate.of(gas)
    side = math.sqrt(68_750 * math.pi / 4.0 / 0.3)
    halos = 700 * 68_750 * (1.0 + 36.0 / side) ** 2
    tiles = 450 * 1.1e6 / 5000
    plan = RankPlan.of(gas, estimate, 16)
    assert halos < one
    assert plan.memory == pytest.approx(280e6 + one + tiles, rel=1e-9)
    lattice = case_of(*changes[:2])
    assert strip_bytes(lattice.gas, 16) == 0.0
    plan = RankPlan.of(lattice.gas, estimate, 16)
    assert plan.memory == pytest.approx(280e6 + halos + tiles, rel=1e-4)
    # A machine with one of the 16 ranks: 191 bytes of the engine, and a strip, or later 200 of the writer for each.
    needed = 68_750 * columns.bytes_per_disk() + one
    options = {"share": 1 / 16, "ranks": 16, "sliced": True}
    monkeypatch.setattr(backend, "memory_available", lambda: needed - 1)
    summary.refuse_beyond_memory(1_100_000, "cpu", **options)
    with pytest.raises(InputError, match=r"1100000 disks need some 123 MB of memory"):
        summary.refuse_beyond_memory(1_100_000, "cpu", start=one, **options)


@pytest.mark.parametrize("n", [10**9, 2**31 - 1, 2 * 2**30 + 5, 2**32 - 1])
def test_slices_and_lattices_of_up_to_2_to_the_32_disks_are_those_of_whole_numbers(n: int) -> None:
    """Bounds of slices, sites of disks, and their random order, by Python's whole numbers, which do not overflow."""
    bounds = distribution.bounds(n, 1000)
    assert bounds.tolist() == [rank * n // 1000 for rank in range(1001)]
    ids = np.arange(n - 5, n)
    for sites in (n, n + 1, n + 200_000):
        assert placement._site_numbers(ids, sites, n).tolist() == [
            number * sites // n for number in ids.tolist()
        ]
    order = np.concatenate([seeds.permuted(1, seeds.SITES, n, range(at, at + 1000)) for at in (0, n - 1000)])
    assert len(set(order.tolist())) == 2000
    assert 0 <= order.min() < order.max() < n
    assert order.mean() == pytest.approx(0.5 * (n - 1), abs=5.0 * n / math.sqrt(12.0 * 2000))


@pytest.mark.parametrize(
    ("n", "ranks", "partners", "message"),
    [
        (2**32 - 1, 49, False, None),
        (3 * 10**9, 34, False, None),
        (2**31 - 1, 24, True, "on 24 ranks: run them on 25 ranks or more"),
        (2**31 - 1, 25, True, None),
        (2**31, 25, True, "2147483648 disks, and latest partners are known of 2147483647 at most"),
        (3 * 10**9, 33, False, "33 ranks: run them on 34 ranks or more"),
        (2**32, 1000, False, "indices allow 4294967295 at most on 1000 ranks$"),
    ],
)
def test_disks_that_indices_of_32_bits_do_not_reach_are_refused(
    n: int, ranks: int, partners: bool, message: str | None
) -> None:
    with pytest.raises(InputError, match=message) if message else contextlib.nullcontext():
        checks.check_number(n, ranks, partners)


def test_growth_of_more_than_a_million_disks_is_for_one_process() -> None:
    found = case_of("species[0].number=1000000", "species[1].number=1000000", "start.positions=grown")
    gas = found.gas
    text = report.report(gas, RunEstimate.of(gas)).text
    assert 'start.positions = "grown" grows all disks in one process' in text
    count, why = gas.usable_ranks(4)
    assert count == 1
    assert why.startswith('start.positions = "grown" of more than 1000000 disks')


def test_kinds_of_a_case_have_the_sums_of_its_disks(monkeypatch: pytest.MonkeyPatch) -> None:
    """To the bit, for blocks within a species and across two; radii whose squares do not add up exactly."""
    monkeypatch.setattr(distribution, "BLOCK", 64)
    radii = ["species[0].radius=0.1", "species[1].radius=0.3", "box.packing_fraction=0.2"]
    drawn = ["species[0].radius=", 'species[0].radii={distribution="uniform",low=0.1,high=0.2}']
    for numbers, more in (
        ((500, 301), []),
        ((64, 128), []),
        ((10, 20), []),
        ((500, 301), drawn),
        ((1500, 10), drawn),
    ):
        changes = [f"species[{i}].number={number}" for i, number in enumerate(numbers)]
        gas = case_of(*radii, *changes, *more).gas
        for name in ("n", "n_movable", "covered", "mean_radius"):
            assert getattr(gas.kinds, name) == getattr(gas.disks, name), name
        assert gas.kinds.every == (sum(numbers) < 1500)
        known = np.unique(gas.disks.radius)
        assert sorted(gas.kinds.radius.tolist()) == known.tolist() or not gas.kinds.every
        assert (gas.kinds.radius.min(), gas.kinds.radius.max()) == (known[0], known[-1])
        parts = [gas.rows(range(at, min(at + 77, gas.n))) for at in range(0, gas.n, 77)]
        for name in ("mass", "radius", "k", "material"):
            assert np.array_equal(
                np.concatenate([getattr(each, name) for each in parts]), getattr(gas.disks, name)
            )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            ["species[0].number=5000000000"],
            "species[0].number = 5000000000: must be an integer from 1 to 4294967295",
        ),
        (
            ["species[0].number=4294967295"],
            "4694967295 disks in all (4294967295 of 'light', 400000000 of 'heavy'): 4294967295 at most are numbered",
        ),
    ],
)
def test_more_disks_than_numbers_can_be_are_refused(changes: list[str], message: str) -> None:
    with pytest.raises(InputError) as error:
        case_of(*changes)
    assert message in str(error.value)
