"""Input from Python: bad arguments are refused by name, before any work, and never cut or extended."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.gases import gas_of

from ifrdem import (
    DSMC,
    Box,
    CollisionLaw,
    Device,
    Disks,
    IFRLaw,
    InputError,
    Ledger,
    Motion,
    Simulation,
    State,
    Study,
    Trajectory,
    TrajectoryWriter,
    Turn,
    Wall,
    collide,
    concat,
    forces,
)
from ifrdem.initial import placement
from ifrdem.simulation.steps.schedule import Trigger

LAW = IFRLaw(e_n=0.9, e_t=-0.5, mu=0.2)


def state(**values: Any) -> State:
    return State(**({"position": np.ones((3, 2)), "velocity": np.ones((3, 2)), "spin": np.zeros(3)} | values))


REFUSED: dict[str, tuple[Callable[[], object], str]] = {
    "material that is no whole number": (lambda: Disks(3, 1.0, 0.5, material=[0.5, 0, 0]), r"material\[0\] = 0.5"),
    "negative material": (lambda: Disks(3, 1.0, 0.5, material=[0, -1, 0]), r"material\[1\] = -1"),
    "two masses for three disks": (lambda: Disks(3, mass=[1, 2], radius=0.5), r"mass has shape \(2,\)"),
    "complex radius": (lambda: Disks(3, 1.0, radius=0.5 + 1j), r"radius = \(0\.5\+1j\): must be a real"),
    "masked mass": (lambda: Disks(2, np.ma.array([1.0, 2.0], mask=[0, 1]), 0.5), "mass is a masked array"),
    "text for n": (lambda: Disks("three", 1.0, 0.5), "n = 'three': must be an integer from 0 to 4294967295"),
    "part of a disk": (lambda: Disks(2.5, 1.0, 0.5), "n = 2.5"),
    "complex positions": (lambda: state(position=np.ones((3, 2)) + 1j), r"position = .*: must be .*, not complex"),
    "masked positions": (lambda: state(position=np.ma.ones((3, 2))), "position is a masked array"),
    "rows of different lengths": (lambda: state(position=[[1.0, 2.0], [1.0]]), r"position = .*: must be an array"),
    "text positions": (lambda: state(position=[["a", "b"]] * 3), r"position = .*: must be an array of real numbers"),
    "spin of one number": (lambda: state(spin=3.0), "spin has shape"),
    "images of a wrong shape": (lambda: state(image=np.zeros((3, 3), dtype=int)), r"image has shape \(3, 3\)"),
    "images that are not whole": (lambda: state(image=np.full((3, 2), 0.5)), r"image\[0, 0\] = 0.5"),
    "negative collisions": (lambda: state(collisions=[1, -2, 0]), r"collisions\[1\] = -2"),
    "collisions of a wrong shape": (lambda: state(collisions=[1, 2]), r"collisions has shape \(2,\)"),
    "negative wall hits": (lambda: state(wall_collisions=[-1, 0, 0]), r"wall_collisions\[0\] = -1"),
    "angle that is not finite": (lambda: state(angle=[0.0, np.nan, 0.0]), r"angle\[1\] = nan"),
    "time that is not finite": (lambda: state(time=np.inf), "time = inf"),
    "text for time": (lambda: state(time="now"), "time = 'now'"),
    "box of one number": (lambda: Box(5), r"lengths = 5: must be a sequence"),
    "box of text": (lambda: Box("55"), r"lengths = '55': must be a sequence"),
    "box of three lengths": (lambda: Box((5, 5, 5)), r"lengths = \(5, 5, 5\): must be a sequence"),
    "sides periodic by text": (lambda: Box((5, 5), ("yes", "no")), "True or False"),
    "one periodic": (lambda: Box((5, 5), True), "periodic = True: must be a sequence of 2, each True or False"),
    "shear beyond numbers": (lambda: Box((5.0, 5.0), shear_rate=1e300), "shear_rate = 1e"),
    "wall that is none": (lambda: gas_of(walls=[1]), r"walls\[0\] = 1"),
    "one wall": (lambda: gas_of(walls=Wall.post((1.0, 1.0), 0.1)), r"walls = Wall.*: must be a sequence"),
    "wall of half a material": (lambda: Wall.post((1.0, 1.0), 0.1, material=0.5), "material = 0.5"),
    "wall at one number": (lambda: Wall.post(3.0, 0.1), r"center = 3\.0: must be a sequence"),
    "motion that is none": (lambda: Wall.post((1.0, 1.0), 0.1, motion="sine"), "motion = 'sine': must be a Motion"),
    "number for a kind of motion": (lambda: Motion(True), "kind = True: must be one of"),
    "number for a kind of turn": (lambda: Turn(1), "kind = 1: must be one of 'still', 'steady', 'sine'"),
    "number for points": (lambda: Wall.polygon(5), r"points = array\(5\.\): must be a sequence"),
    "number for a shape": (lambda: Wall(3, (0, 0)), "shape = 3: must be one of"),
    "huge radius": (
        lambda: Wall.post((0, 0), 1e200),
        r"radius = 1e\+200: must be",
    ),
    "huge place": (lambda: Wall.line((0, 1e300), (0, 1)), r"point\[1\] = 1e\+300: must be a finite"),
    "text for a speed": (lambda: Motion("steady", speed="fast"), "speed = 'fast'"),
    "mu beyond numbers": (lambda: IFRLaw(e_n=0.9, e_t=-0.5, mu=1e300), "mu = 1e"),
    "k beyond numbers": (lambda: IFRLaw(e_n=0.9, e_t=-0.5, mu=0.2, k=1e300), "k = 1e"),
    "k of a pair beyond numbers": (lambda: LAW.admissibility(1e300, 2.0), "k_i = 1e"),
    "complex e_n": (lambda: IFRLaw(e_n=0.5j, e_t=-0.5, mu=0.2), "e_n = 0.5j"),
    "whole number beyond floats": (lambda: IFRLaw(e_n=0.9, e_t=0.0, mu=10**400), "mu = an int of 1329 bits: must"),
    "speeds beyond numbers": (lambda: placement.maxwellian([1.0, 1.0], speed_rms=1e300, seed=1), "speed_rms = 1e"),
    "spins beyond numbers": (lambda: placement.gaussian_spins(3, spin_rms=1e300, seed=1), "spin_rms = 1e"),
    "complex radii": (lambda: placement.random_positions(Box((9, 9)), [0.5j], seed=1), r"radius = \[0\.5j\]: must be"),
    "frame_callbacks that are none": (lambda: gas_of().run(t_end=1.0, frame_callbacks=[1]), r"frame_callbacks\[0\] = 1"),
    "one observer": (lambda: gas_of().run(t_end=1.0, frame_callbacks=print), r"frame_callbacks = .*: must be a list"),
    "progress that is 0": (lambda: gas_of().run(t_end=1.0, progress=0), "progress = 0: must be True, False or a function"),
    "progress that is empty": (lambda: gas_of().run(t_end=1.0, progress=[]), r"progress = \[\]: must be True, False or"),
    "series_callbacks that are none": (
        lambda: gas_of().run(t_end=1.0, series_callbacks=[1]),
        r"series_callbacks\[0\] = 1",
    ),
    "progress that is none": (lambda: gas_of().run(t_end=1.0, progress=1), "progress = 1"),
    "frames without end": (lambda: gas_of().run(t_end=1.0, frames=10**18), "frames = 10+: .* 1 to 10000000"),
    "half a frame": (lambda: gas_of().run(t_end=1.0, frames=0.5), "frames = 0.5"),
    "text for frames": (lambda: gas_of().run(t_end=1.0, frames="many"), "frames = 'many'"),
    "series without end": (lambda: gas_of().run(t_end=1.0, series=10**18), "series = 10+"),
    "intervals without end": (lambda: gas_of().run(t_end=1.0, frames=Trigger(interval=1e-12)), "times in this run"),
    "collisions without end": (
        lambda: gas_of().run(collisions_per_disk=1.0, frames=Trigger(collisions=1e-12)), "times in this run",
    ),
    "text for the end": (lambda: gas_of().run(t_end="soon"), "t_end = 'soon'"),
    "state that is none": (lambda: Simulation(Disks(1, 1.0, 0.5), Box((9, 9)), LAW, 3), "state = 3: must be a State"),
    "box that is none": (lambda: Simulation(Disks(1, 1.0, 0.5), (9, 9), LAW, state()), "must be a Box"),
    "coefficient beyond single precision": (
        lambda: Simulation(
            *gases_of_three(), IFRLaw(e_n=0.9, e_t=-1.0, mu=0.0, rho=1e40), state_of_three(),
            device=Device(precision="f32"),
        ),
        "beyond 1e",
    ),
    "bits for the bytes of a file": (
        lambda: TrajectoryWriter("none.h5", *gases_of_three(), precision="f8"),
        r"""must be one of 'f32', 'f64' \(it is called "f64" now\)""",
    ),
    "number for the file of a writer": (lambda: TrajectoryWriter(5, *gases_of_three()), "path = 5: must be a text"),
    "disks of a writer that are none": (lambda: TrajectoryWriter("n.h5", 3, Box((9, 9))), "disks = 3: must be a Disks"),
    "box of a writer that is none": (lambda: TrajectoryWriter("n.h5", Disks(1, 1, 1), 9), "box = 9: must be a Box"),
    "text for units": (lambda: TrajectoryWriter("n.h5", *gases_of_three(), units="SI"), "units = 'SI': must be"),
    "number for parameters": (
        lambda: TrajectoryWriter("n.h5", *gases_of_three(), parameters=5), "parameters = 5: must be a mapping",
    ),
    "disks of DSMC that are none": (lambda: DSMC(5, LAW, 0.1, [[1, 0]]), "disks = 5: must be a Disks"),
    "text for a law": (lambda: Simulation(*gases_of_three(), "x", state_of_three()), "law = 'x': must be an IFRLaw"),
    "list for a table": (lambda: Simulation(*gases_of_three(), [LAW], state_of_three()), "a list of lists of laws"),
    "None for a law": (lambda: Simulation(*gases_of_three(), [[None]], state_of_three()), r"law\[0\]\[0\] = None"),
    "class for a force": (
        lambda: gas_of(forces=[forces.Langevin]), r"forces\[0\] = <class '.*Langevin'>: must be an object of a class",
    ),
    "number for forces": (lambda: gas_of(forces=5), "forces = 5: must be a list of forces"),
    "text for an end": (lambda: gas_of().collide_until("soon"), "t_end = 'soon': must be a finite time"),
    "number for a checkpoint": (lambda: gas_of().load_checkpoint(5), "path = 5: must be a text or a path"),
    "text for radii": (lambda: Box.from_packing_fraction("a", 0.5), r"radius = 'a': must be an array"),
    "number for a study": (lambda: Study(5), "path = 5: must be a text or a path"),
    "number for trajectories": (lambda: concat(5), "trajectories = 5: must be a list of trajectories or files"),
    "one file for trajectories": (lambda: concat("a.h5"), r"trajectories = 'a\.h5': must be a list"),
    "k of disks beyond numbers": (
        lambda: Simulation(Disks(3, 1.0, 0.5, k=1e300), gases_of_three()[1], LAW, state_of_three()), "k = 1e",
    ),
    "complex velocity": (lambda: DSMC(Disks(2, 1.0, 0.5), LAW, 0.1, np.ones((2, 2)) * 1j), r"velocity = .*not complex"),
    "parameter that is none": (lambda: forces.Drag(0.1, rate="much"), "rate = 'much'"),
}  # fmt: skip


def gases_of_three() -> tuple[Disks, Box]:
    return Disks(3, 1.0, 0.5), Box((9.0, 9.0))


def state_of_three() -> State:
    return state(position=[[1.0, 1.0], [3.0, 3.0], [6.0, 6.0]])


@pytest.mark.parametrize("case", list(REFUSED))
def test_input_that_does_not_fit_is_refused_by_name(case: str) -> None:
    act, says = REFUSED[case]
    with pytest.raises(InputError, match=says):
        act()


def test_states_that_were_changed_are_looked_at_again() -> None:
    disks, box = gases_of_three()
    changed = state_of_three()
    changed.velocity = np.full((3, 2), np.nan)
    with pytest.raises(InputError, match=r"velocity\[0\]"):
        Simulation(disks, box, LAW, changed)


class Spring(forces.Force):
    """A custom force with an additional attribute."""

    def __init__(self, stiffness: float) -> None:
        super().__init__(0.1)
        self.stiffness = stiffness

    @staticmethod
    def act(disk, step, p):
        return disk.vx, disk.vy, disk.spin


class Own(CollisionLaw):
    coefficients = ("e",)
    note: str

    @staticmethod
    def collide(pair, law):
        return pair.m_n * pair.g_n * (1.0 + law.e), 0.0 * pair.g_t, 0.0


@pytest.fixture(scope="module")
def things(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """One of each public class that holds anything."""
    path: Path = tmp_path_factory.mktemp("things") / "gas.h5"
    one = gas_of(20, histories=[0])
    writer = TrajectoryWriter(path, one.disks, one.box)
    writer.begin_histories([0], one.state)
    one.run(t_end=1.0, frame_callbacks=[lambda state, measure: writer.write(state)])
    writer.write_histories(one.take_events().columns(), one.time)
    trajectory = Trajectory(path)
    velocity = placement.maxwellian(np.ones(20), speed_rms=1.0, seed=1)
    return {
        "Simulation": one,
        "DSMC": DSMC(one.disks, LAW, 0.1, velocity),
        "Disks": one.disks,
        "State": one.state,
        "Measure": one.measure(),
        "Box": one.box,
        "Wall": Wall.post((1.0, 1.0), 0.1),
        "Motion": Motion(),
        "IFRLaw": LAW,
        "Collision": collide(LAW, [1, 0], [1, 1], [1, 1], [2, 2], [[1, 0], [0, 0]], [0, 0]),
        "Drag": forces.Drag(0.1, rate=1.0),
        "TableFriction": forces.TableFriction(0.1, mu=0.3),
        "TrajectoryWriter": writer,
        "Trajectory": trajectory,
        "Frame": trajectory[0],
        "Series": trajectory.observables,
        "History": trajectory.history(0),
        "Ledger": Ledger(),
        "Trigger": Trigger(number=3),
    }


READ_ONLY = {
    "Simulation": [
        "time",
        "state",
        "has_ledger",
        "disks",
        "box",
        "energy_input",
        "run",
        "law",
        "gravity",
        "forces",
    ],
    "DSMC": ["time", "velocity", "disks", "driving", "area", "collisions"],
    "Disks": ["mass", "n"],
    "State": ["n", "peculiar_velocity"],
    "Measure": ["time", "energy"],
    "Box": ["lengths", "area"],
    "Wall": ["temperature"],
    "Motion": ["speed"],
    "IFRLaw": ["mu", "e_n", "k"],
    "Collision": ["velocity"],
    "Drag": ["step", "keeps_rest"],
    "TableFriction": ["step"],
    "TrajectoryWriter": ["path"],
    "Trajectory": ["box", "times", "disks", "series"],
    "Frame": ["index", "position"],
    "Series": ["time"],
    "History": ["disk"],
    "Ledger": [],
    "Trigger": ["number"],
}


@pytest.mark.parametrize("kind", list(READ_ONLY))
def test_unknown_and_read_only_attributes_cannot_be_assigned(things: dict[str, Any], kind: str) -> None:
    for name in ["no_such_thing", *READ_ONLY[kind]]:
        with pytest.raises(AttributeError):
            setattr(things[kind], name, 1)


def test_a_refused_attribute_names_what_to_use_instead(things: dict[str, Any]) -> None:
    one = things["Simulation"]
    for name in ("law", "forces", "gravity", "velocities"):
        with pytest.raises(InputError, match=rf"use set_{name}\(\.\.\.\)"):
            setattr(one, name, 1)
    with pytest.raises(InputError, match="did you mean 'tracked'"):
        one.traked = [1]
    with pytest.raises(InputError, match="did you mean 'velocity'"):
        things["State"].velocty = 1
    with pytest.raises(InputError, match="read-only"):
        one.time = 3.0


def test_documented_assignable_attributes_are_assignable() -> None:
    drag = forces.Drag(0.1, rate=1.0)
    drag.rate = 2.0
    assert drag.values == {"rate": 2.0, "quadratic": 0.0, "spin_rate": 0.0}
    with pytest.raises(InputError, match="rate = 'a'"):
        drag.rate = "a"
    assert drag.rate == 2.0
    spring = Spring(2.0)
    spring.stiffness = 3.0
    own = Own(e=0.5)
    own.note = "mine"
    start = state()
    start.velocity = np.zeros((3, 2))
    assert not start.velocity.any()
