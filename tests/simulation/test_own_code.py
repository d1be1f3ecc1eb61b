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

import ifrdem
from ifrdem import Device, InputError, theory, ti
from ifrdem.runs.run import _mechanisms

DISKS = ifrdem.Disks(2, mass=1.0, radius=0.5)
BOX = ifrdem.Box((10.0, 10.0))
STATE = ifrdem.State([[1.0, 5.0], [4.0, 5.0]], [[1.0, 0.0], [0.0, 0.0]], [0.0, 0.0])
SMOOTH = ifrdem.IFRLaw(e_n=0.9, e_t=-1.0, mu=0.0)


def two_disks(law: ifrdem.CollisionLaw = SMOOTH, **options: Any) -> ifrdem.Simulation:
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
    [(ReadsTwo(e_n=0.5), r"law has e_n$"),
     (ReadsOne(), "law has no names$")],
)  # fmt: skip
def test_a_coefficient_that_a_law_has_not_is_refused(law: ifrdem.CollisionLaw, message: str) -> None:
    """Taichi's compiler aborts the process at the first; the second read a 0."""
    with pytest.raises(InputError, match=message):
        two_disks(law)


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
        r"line \d+, in \w+: .*there is no 'rat' \(did you mean 'rate'\?\); p has rate, b$",
    ),
    "parameter without names": (
        force(misspelt_parameter), {}, "there is no 'rat'; p has no names$"
    ),
    "parameter by number": (
        force(second_parameter, names=("rate",)), {"rate": 1.0},
        r"\[1\]: must be a name after a dot; .*; p has rate$",
    ),
    "no totals": (force(any_total), {}, "there is no 'totals'; step has time, .*; totals require a class attribute"),
    "second of one total": (
        force(second_total, mass_alone, 1), {}, r"in second_total: .*index 1 does not exist: must be 0$"
    ),
    "second of one term": (
        force(second_total, mass_alone, 2), {}, "measure a ti.Vector of length 2"
    ),
    "misspelt quantity of a disk": (
        force(misspelt_spin), {},
        r"there is no 'spn' \(did you mean 'spin'\?\); disk has x, y, vx, vy, spin, mass, radius, k, inertia, id, "
        r"species, material$",
    ),
    "misspelt quantity of a step": (
        force(any_total, misspelt_time, 1), {},
        r"there is no 'dtt' \(did you mean 'dt'\?\); step has time, dt, .*totals \(in act\), share \(in act\)$",
    ),
    "quantity of something else": (force(time_as_spin), {}, "there is no 'spin'; step has time, dt, free, random$"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG_FORCES)
def test_what_a_force_has_not_is_one_error_that_lists_what_there_is(name: str) -> None:
    kind, values, message = WRONG_FORCES[name]
    with pytest.raises(InputError, match=rf"forces\[0\] = Mine: .*{message}"):
        two_disks(forces=[kind(0.1, **values)])


@pytest.mark.full
def test_a_wrong_parameter_of_a_force_does_not_end_the_process() -> None:
    """In a separate process, which Taichi's compiler would abort."""
    names = [name for name in WRONG_FORCES if "parameter" in name]
    script = (
        "import sys; sys.path.insert(0, 'tests/simulation')\n"
        "from test_own_code import WRONG_FORCES, InputError, two_disks\n"
        f"for name in {names!r}:\n"
        "    kind, values, _ = WRONG_FORCES[name]\n"
        "    try:\n"
        "        two_disks(forces=[kind(0.1, **values)])\n"
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


def two_numbers(disk, step, p):
    return disk.vx, disk.vy


def without_parameters(disk, step):
    return disk.vx, disk.vy, disk.spin


def two_rates(disk, step, p):
    return p.rate * disk.vx, p.b * disk.vy, disk.spin


@pytest.mark.parametrize(
    ("act", "message"),
    [(two_numbers, "must return three numbers, vx, vy and spin"),
     (without_parameters, r"without_parameters\(disk, step\): must be a static method"),
     (mass_alone, "must return three numbers, vx, vy and spin")],
)  # fmt: skip
def test_what_act_must_take_and_return_is_in_the_message(act: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        two_disks(forces=[force(act)(0.1)])


@pytest.mark.parametrize("totals", [-1, 1.5, "two"])
def test_the_number_of_totals_is_checked_when_the_class_is_made(totals: Any) -> None:
    with pytest.raises(InputError, match=f"Mine: totals = {totals!r}: must be"):
        force(mass_alone, totals=totals)


@pytest.mark.parametrize(
    ("values", "message"),
    [({"rate": 1.0}, "Mine: parameter 'b' is missing: must be a finite number; .* are rate, b$"),
     ({"rat": 1.0, "b": 2.0}, r"Mine: unknown parameter 'rat' \(did you mean 'rate'\?\); .* are rate, b$"),
     ({"rate": "fast", "b": 2.0}, "rate = 'fast': must be a finite number")],
)  # fmt: skip
def test_a_wrong_parameter_of_a_force_is_named_with_those_that_there_are(values: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        force(two_rates, names=("rate", "b"))(0.1, **values)


@pytest.mark.parametrize("given", [ifrdem.forces.Drag(0.1, rate=1.0), ifrdem.forces.Drag, 3, None, "drag"])
def test_forces_must_be_a_list(given: Any) -> None:
    with pytest.raises(InputError, match=r"forces = .*: must be"):
        two_disks(forces=given)
    with pytest.raises(InputError, match=r"must be a list of forces, \[force\] for one"):
        two_disks().set_forces(given)


def test_a_misspelt_attribute_of_a_force_or_law_is_refused() -> None:
    class Noted(ifrdem.forces.Force):
        parameters = ("rate", "b")
        note: str
        act = staticmethod(two_rates)

    class Smooth(ifrdem.CollisionLaw):
        coefficients = ("e_n",)

        @staticmethod
        def collide(pair: Any, law: Any) -> tuple[Any, Any, Any]:
            return (1.0 + law.e_n) * pair.m_n * pair.g_n, 0.0, 0.0

    drag, own, law = ifrdem.forces.Drag(0.1, rate=1.0), Noted(0.1, rate=1.0, b=2.0), Smooth(e_n=0.9)
    for thing, name, message in (
        (drag, "rtae", "Drag has no attribute 'rtae' .did you mean 'rate'"),
        (own, "rtae", "Noted has no attribute 'rtae' .did you mean 'rate'"),
        (own, "step", "Noted.step is read-only"),
        (own, "totals", "Noted.totals is read-only"),
        (law, "e_n", "Smooth.e_n is read-only"),
        (law, "e_m", "Smooth has no attribute 'e_m' .did you mean 'e_n'"),
    ):
        with pytest.raises(AttributeError, match=message):
            setattr(thing, name, 2.0)
    own.rate, own.note = 3.0, "declared in the class"
    assert own.values == {"rate": 3.0, "b": 2.0}
    assert law.e_n == 0.9


FACTOR = 1.0


def doubled(value):
    return 2.0 * FACTOR * value


class Outside(ifrdem.forces.Force):
    """A force that uses a variable of the module, by way of a function."""

    @staticmethod
    def act(disk, step, p):
        return doubled(disk.vx), disk.vy, disk.spin


class OutsideLaw(ifrdem.CollisionLaw):
    """A law that does."""

    @staticmethod
    def collide(pair: Any, law: Any) -> tuple[Any, Any, Any]:
        return (1.0 + 0.5 * FACTOR) * pair.m_n * pair.g_n, 0.0, 0.0


class OutsideLedger(ifrdem.CollisionLaw):
    """A law whose ledger does."""

    @staticmethod
    def collide(pair: Any, law: Any) -> tuple[Any, Any, Any]:
        return 1.5 * pair.m_n * pair.g_n, 0.0, 0.0

    @staticmethod
    def parts(pair: Any, law: Any) -> tuple[Any, ...]:
        return 1.5 * pair.m_n * pair.g_n, 0.0, 0.0, 0.0 * FACTOR, 0.0, 0.0


@pytest.mark.full
@pytest.mark.filterwarnings("ignore::SyntaxWarning")
@pytest.mark.parametrize(
    "given", [{"forces": [Outside(0.1)]}, {"law": OutsideLaw()}, {"law": OutsideLedger()}]
)
def test_a_variable_from_outside_that_is_compiled_in_must_not_change(
    given: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = two_disks(**given)
    first.run_for(time=0.1)
    monkeypatch.setitem(globals(), "FACTOR", 2.0)
    for use in (lambda: two_disks(**given), lambda: first.run_for(time=0.1)):
        with pytest.raises(InputError, match=r"FACTOR = 2.0: must stay 1.0: .* make it a parameter"):
            use()
    monkeypatch.setitem(globals(), "FACTOR", 1.0)
    first.run_for(time=0.1)


e_n = 0.9


class OwnNumber(ifrdem.CollisionLaw):
    """A law whose coefficient has the name of a variable of the module."""

    coefficients = ("e_n",)

    @staticmethod
    def collide(pair: Any, law: Any) -> tuple[Any, Any, Any]:
        return (1.0 + law.e_n) * pair.m_n * pair.g_n, 0.0, 0.0


@pytest.mark.full
def test_a_variable_with_the_name_of_a_coefficient_may_change(monkeypatch: pytest.MonkeyPatch) -> None:
    """Like a script that runs a gas for each value of a loop."""
    for value in (0.9, 0.5):
        monkeypatch.setitem(globals(), "e_n", value)
        simulation = two_disks(law=OwnNumber(e_n=value))
        simulation.run(collisions_per_disk=1)
        velocity = simulation.state.velocity[:, 0]
        assert velocity[1] - velocity[0] == pytest.approx(value, rel=1e-12)


def test_a_run_that_does_nothing_says_so() -> None:
    simulation = two_disks()
    simulation.run(t_end=0.0)  # nothing has moved yet: no warning
    simulation.run(collisions_per_disk=1)
    with pytest.warns(ifrdem.RunWarning, match=r"collisions_per_disk = 1 .* for as much again, .* = 2"):
        simulation.run(collisions_per_disk=1)
    with pytest.warns(ifrdem.RunWarning, match="t_end = "):
        simulation.run(t_end=simulation.time)
    assert simulation.collisions == 1


def test_a_checkpoint_is_not_loaded_by_the_class() -> None:
    with pytest.raises(InputError, match=r"Simulation\.from_checkpoint\(path\)"):
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
    with pytest.raises(InputError, match=r"law = .*must be a law that says has_averages"):
        theory.cooling_ratios({"e_n": 0.9, "mew": 0.1}, 2.0)


def test_negative_energy_of_a_mechanism_is_explained() -> None:
    """Of normal 3, tangential restitution 50, sticking -36.4: friction and restitution together took 13.6."""
    lines = list(_mechanisms(np.array([3.0, 50.0, 0.0, -36.4, 0.0, 0.0, 0.0]), 100.0, " J"))
    assert lines[0] == "by mechanism: normal 3, tangential restitution 50, sticking -36.4 J"
    assert "sticking below 0" in lines[1]
    assert lines[1].endswith("together they took 13.6 J")
    assert len(list(_mechanisms(np.array([3.0, 50.0, 1.0, 0.0, 0.0, 0.0, 0.0]), 100.0, ""))) == 1


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
