"""Custom laws and forces that read unknown coefficients, runs that do nothing, names in messages."""

from __future__ import annotations

import importlib
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import taichi as ti

import ifrdem
from ifrdem import Device, InputError, theory
from ifrdem.runs.run import _mechanisms

DISKS = ifrdem.Disks(2, mass=1.0, radius=0.5)
BOX = ifrdem.Box((10.0, 10.0))
STATE = ifrdem.State([[1.0, 5.0], [4.0, 5.0]], [[1.0, 0.0], [0.0, 0.0]], [0.0, 0.0])
SMOOTH = ifrdem.IFRLaw(e_n=0.9, e_t=-1.0, mu=0.0)


def gas(law: ifrdem.CollisionLaw = SMOOTH, **options: Any) -> ifrdem.Simulation:
    return ifrdem.Simulation(DISKS, BOX, law, STATE, device=Device(threads=1), **options)


class ReadsTwo(ifrdem.CollisionLaw):
    """A law of one coefficient that reads a second one."""

    coefficients = ("e_n",)

    @staticmethod
    def collide(pair: Any, law: Any) -> tuple[Any, Any, Any]:
        return (1.0 + law[1]) * pair.m_n * pair.g_n, 0.0, 0.0


class ReadsOne(ifrdem.CollisionLaw):
    """A law without coefficients that reads one."""

    @staticmethod
    def collide(pair: Any, law: Any) -> tuple[Any, Any, Any]:
        return (1.0 + law[0]) * pair.m_n * pair.g_n, 0.0, 0.0


@pytest.mark.parametrize(
    ("law", "message"),
    [(ReadsTwo(e_n=0.5), r"law has e_n; pair has"),
     (ReadsOne(), "law has no coefficients; pair has")],
)  # fmt: skip
def test_a_coefficient_that_a_law_has_not_is_refused(law: ifrdem.CollisionLaw, message: str) -> None:
    """Taichi's compiler aborts the process at the first; the second read a 0."""
    with pytest.raises(InputError, match=message):
        gas(law)


def force(act: Any, measure: Any = None, totals: int = 0, names: tuple[str, ...] = ()) -> Any:
    """A class of forces."""
    members: dict[str, Any] = {"act": staticmethod(act), "totals": totals, "parameters": names}
    members |= {} if measure is None else {"measure": staticmethod(measure)}
    return type("Mine", (ifrdem.forces.Force,), members)


def misspelt_parameter(disk, step, p):
    return disk.vx * p.rat, disk.vy, disk.spin


def second_parameter(disk, step, p):
    return disk.vx * p[1], disk.vy, disk.spin


def any_total(disk, step, p):
    return disk.vx * step.totals[0], disk.vy, disk.spin


def second_total(disk, step, p):
    return disk.vx * step.totals[1], disk.vy, disk.spin


def misspelt_spin(disk, step, p):
    return disk.vx, disk.vy, disk.spn


def misspelt_time(disk, step, p):
    return ti.Vector([disk.mass * step.dtt])


def time_as_spin(disk, step, p):
    return disk.vx, disk.vy, step.spin


def mass_alone(disk, step, p):
    return ti.Vector([disk.mass])


WRONG_FORCES: dict[str, tuple[Any, dict[str, float], str]] = {
    "misspelt parameter": (
        force(misspelt_parameter, names=("rate", "b")), {"rate": 1.0, "b": 2.0},
        r"there is no 'rat' \(did you mean 'rate'\?\); .*; parameters has rate, b",
    ),
    "parameter without names": (
        force(misspelt_parameter), {}, "there is no 'rat'; .*; parameters has no names"
    ),
    "parameter by number": (
        force(second_parameter, names=("rate",)), {"rate": 1.0},
        r"\[1\]: must be a name after a dot; .*; parameters has rate",
    ),
    "no totals": (force(any_total), {}, "there is no 'totals'; disk has .*; it has 0 totals"),
    "second of one total": (
        force(second_total, mass_alone, 1), {}, "index 1 does not exist: must be 0; it has 1 total"
    ),
    "second of one term": (
        force(second_total, mass_alone, 2), {}, "index 1 does not exist: must be 0; it has 2 totals"
    ),
    "misspelt quantity of a disk": (
        force(misspelt_spin), {},
        r"there is no 'spn' \(did you mean 'spin'\?\); disk has x, y, vx, vy, spin, mass, radius, k, inertia; "
        "step has time, dt, free, random; parameters has no names; it has 0 totals",
    ),
    "misspelt quantity of a step": (
        force(any_total, misspelt_time, 1), {},
        r"there is no 'dtt' \(did you mean 'dt'\?\); .* in act, step also has totals",
    ),
    "quantity of something else": (force(time_as_spin), {}, "there is no 'spin'; disk has x, y, vx, vy, spin"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG_FORCES)
def test_what_a_force_has_not_is_one_error_that_lists_what_there_is(name: str) -> None:
    kind, values, message = WRONG_FORCES[name]
    with pytest.raises(InputError, match=rf"forces\[0\] = Mine: .*{message}"):
        gas(forces=[kind(0.1, **values)])


def test_a_wrong_parameter_of_a_force_does_not_end_the_process() -> None:
    """In a process of its own, which Taichi's compiler would abort."""
    names = [name for name in WRONG_FORCES if "parameter" in name]
    script = (
        "import sys; sys.path.insert(0, 'tests/simulation')\n"
        "from test_own_code import WRONG_FORCES, InputError, gas\n"
        f"for name in {names!r}:\n"
        "    kind, values, _ = WRONG_FORCES[name]\n"
        "    try:\n"
        "        gas(forces=[kind(0.1, **values)])\n"
        "    except InputError as error:\n"
        "        print(error)\n"
    )
    root = Path(__file__).parents[2]
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, cwd=root, check=False
    )
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert len(lines) == len(names), done.stdout
    for line, name in zip(lines, names, strict=True):
        assert re.search(WRONG_FORCES[name][2], line), line


def test_a_parameter_cannot_have_the_name_of_something_else() -> None:
    for names in (("step",), ("totals",), ("a b",), (1,)):
        with pytest.raises(InputError, match=r"Mine: parameters = .*: must be names"):
            force(mass_alone, names=names)  # type: ignore[arg-type]


def test_a_run_that_does_nothing_says_so() -> None:
    simulation = gas()
    simulation.run(t_end=0.0)  # nothing has moved yet: a start is asked for
    simulation.run(collisions_per_disk=1)
    with pytest.warns(ifrdem.RunWarning, match=r"collisions_per_disk = 1 .* for as much again, .* = 2"):
        simulation.run(collisions_per_disk=1)
    with pytest.warns(ifrdem.RunWarning, match="t_end = "):
        simulation.run(t_end=simulation.time)
    assert simulation.collisions == 1


def test_a_checkpoint_is_not_loaded_by_the_class() -> None:
    with pytest.raises(InputError, match=r"gas = ifrdem.Simulation\(\.\.\.\), then gas.load_checkpoint"):
        ifrdem.Simulation.load_checkpoint("gas.npz")  # type: ignore[arg-type]


def test_tables_with_materials_that_never_meet_are_laws_to_the_theory() -> None:
    """`Trajectory.laws` has None for materials that never meet."""
    law = ifrdem.IFRLaw(e_n=0.9, e_t=-0.8, mu=0.2, sticking="contact_point")
    found = theory.prediction(DISKS, [[law, None], [None, None]], 0.2, 1.0, 0.0, [0.0, 1.0])
    np.testing.assert_array_equal(
        found.temperature, theory.prediction(DISKS, law, 0.2, 1.0, 0.0, [0.0, 1.0]).temperature
    )
    disks = ifrdem.Disks(2, mass=1.0, radius=0.5, material=[0, 1])
    with pytest.raises(InputError, match=r"law\[.*\] = None"):
        theory.prediction(disks, [[law, None], [None, law]], 0.2, 1.0, 0.0, [0.0, 1.0])
    with pytest.raises(InputError, match=r"law = .*must be an IFRLaw"):
        theory.cooling_ratios({"e_n": 0.9, "mew": 0.1}, 2.0)


def test_negative_energy_of_a_mechanism_is_explained() -> None:
    """Of normal 3, tangential restitution 50, sticking -36.4: friction and restitution together took 13.6."""
    lines = list(_mechanisms(np.array([3.0, 50.0, 0.0, -36.4, 0.0, 0.0, 0.0]), " J"))
    assert lines[0] == "by mechanism: normal 3, tangential restitution 50, sticking -36.4 J"
    assert "sticking below 0" in lines[1]
    assert lines[1].endswith("together they took 13.6 J")
    assert len(list(_mechanisms(np.array([3.0, 50.0, 1.0, 0.0, 0.0, 0.0, 0.0]), ""))) == 1


def test_names_of_the_package_in_its_sources_exist() -> None:
    """Messages and docstrings name `ifrdem.something` only if it is there."""
    for path in sorted(Path(ifrdem.__file__).parent.rglob("*.py")):
        for name in re.findall(r"\bifrdem((?:\.[A-Za-z_]\w*)+)", path.read_text(encoding="utf-8")):
            found: Any = ifrdem
            for part in name[1:].split("."):
                if not hasattr(found, part):
                    found = importlib.import_module(f"{found.__name__}.{part}")
                else:
                    found = getattr(found, part)
