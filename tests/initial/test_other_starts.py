"""Starts from dumps of LAMMPS and extended XYZ: columns by name, types as species, ids in any order."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.cases import case_text

import ifrdem
from ifrdem.cli import main as cli
from ifrdem.errors import InputError
from ifrdem.initial import from_csv
from ifrdem.tools.tables import TableFormat

LAMMPS = """\
ITEM: UNITS
lj
ITEM: TIMESTEP
0
ITEM: NUMBER OF ATOMS
3
ITEM: BOX BOUNDS pp pp pp
-1 3
1 3
-0.1 0.1
ITEM: ATOMS id type x y z vx vy vz omegax omegay omegaz
2 2 0.5 1.5 0 1 2 0 0 0 3
3 1 -1.0001 2.9 0 4 5 0 0 0 6
1 1 2.1 1.2 0 7 8 0 0 0 9
"""
XYZ = (
    '3\nLattice="4 0 0 0 2 0 0 0 1" Origin="-1 1 0" Properties=species:S:1:pos:R:3:velo:R:3:angular_velocity:R:1 pbc="T T F"\n'
    "big_one 0.5 1.5 0 1 2 0 3\nsmall 2.1 1.2 0 7 8 0 9\nsmall 2.9999 2.9 0 4 5 0 6\n"
)
SPECIES = [("small", 2), ("big one", 1)]
BOX = ifrdem.Box((4.0, 2.0))
POSITION = [[3.1, 0.2], [3.9999, 1.9], [1.5, 0.5]]
MOTION = [[7.0, 8.0, 9.0], [4.0, 5.0, 6.0], [1.0, 2.0, 3.0]]


def read(tmp_path: Path, text: str, **options) -> from_csv.StartData:
    (tmp_path / "start.dump").write_text(text, encoding="utf-8")
    given = {"species": SPECIES, "units": "reduced", "box": BOX, "n": 3} | options
    return from_csv.read(tmp_path / "start.dump", **given)


SCALED = LAMMPS.replace(" x y z ", " xs ys zs ").replace("0.5 1.5 0", "0.375 0.25 0.5")
SCALED = SCALED.replace("-1.0001 2.9 0", "0.999975 0.95 0.5").replace("2.1 1.2 0", "0.775 0.1 0.5")


@pytest.mark.parametrize(
    "text",
    [
        LAMMPS,
        LAMMPS.replace(" x y z ", " xu yu zu ").replace("2.1 1.2 0", "6.1 -0.8 0"),  # unwrapped, a box further
        SCALED,
        LAMMPS.replace("ITEM: UNITS\nlj\n", ""),
        LAMMPS.replace("\n2 2 0.5", "\n1 2 0.5").replace("\n3 1 -1", "\n2 1 -1").replace("\n1 1 2", "\n0 1 2"),  # from 0
        XYZ,
        LAMMPS.replace(" vx vy vz ", " u v vz "),
    ],
    ids=["as dumped", "unwrapped", "scaled", "without units", "ids from 0", "extended XYZ", "named"],
)  # fmt: skip
def test_each_layout_gives_disks_in_the_order_of_species_and_ids(text: str, tmp_path: Path) -> None:
    """The box begins at (-1, 1): x + 1 and y - 1; the disk just below its side comes back at the other one."""
    form = TableFormat(columns={"vx": "u", "vy": "v"}) if " u v " in text else None
    found = read(tmp_path, text, form=form)
    assert found.velocity is not None
    assert found.spin is not None
    assert found.position == pytest.approx(np.array(POSITION), abs=1e-9)
    assert np.column_stack([found.velocity, found.spin]).tolist() == MOTION


def test_frames_are_numbered_and_the_last_is_taken(tmp_path: Path) -> None:
    later = LAMMPS.replace("TIMESTEP\n0", "TIMESTEP\n10").replace(" 0 7 8 0 0 0 9", " 0 7 8 0 0 0 90")
    both = LAMMPS + later.replace("ITEM: UNITS\nlj\n", "")
    for frame, spin in ((None, 90.0), (-1, 90.0), (0, 9.0), (1, 90.0)):
        found = read(tmp_path, both, frame=frame)
        assert found.spin is not None
        assert found.spin[0] == spin
    with pytest.raises(InputError, match="frame = 2: the file has 2 frames"):
        read(tmp_path, both, frame=2)
    with pytest.raises(InputError, match="frame = 0: is of dumps of LAMMPS"):
        read(tmp_path, "x,y\n1,1\n", frame=0)


def test_units_are_those_of_the_case_or_given(tmp_path: Path) -> None:
    """A dump in cgs: cm become m if the case says so; nothing is converted by itself."""
    text = LAMMPS.replace("lj", "cgs")
    with pytest.raises(
        InputError, match="is in LAMMPS's units cgs, and the case in SI: give units of x, y, vx, vy, spin"
    ):
        read(tmp_path, text, units="SI")
    form = TableFormat(units={"x": "cm", "y": "cm", "vx": "cm/s", "vy": "cm/s", "spin": "rad/s"})
    found = read(tmp_path, text, units="SI", form=form, box=ifrdem.Box((0.04, 0.02)))
    assert found.velocity is not None
    assert found.spin is not None
    assert found.position == pytest.approx(0.01 * np.array(POSITION), abs=1e-12)
    assert np.column_stack([100.0 * found.velocity, found.spin]) == pytest.approx(np.array(MOTION))


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("omegaz", "wz", r"lacks spin \(spin from omegaz, .*\): write them, or name them by columns; or write no velocities"),
        (" x y z ", " q y z ", r"lacks x \(x from x, xu, xs, .*\): write them"),
        ("-1 3", "-1 5", "its box is 6 x 2: must be that of the case, 4 x 2; box.lengths sets it"),
        ("pp pp pp", "xy xz yz pp pp pp", "line 7: a box that is tilted cannot start a run"),
        ("2 2 0.5", "2 3 0.5", "type 3: is no species of the case; these are 1 or small, 2 or big one"),
        ("2 2 0.5", "2 1 0.5", r"has 3 disks of type 1: must be 2, the number of species\[0\], small"),
        ("2 2 0.5", "1 2 0.5", "id 1: is given twice"),
        ("0.5 1.5", "0.5 up", "line 12: y = up: must be a finite number"),
        ("3\n2 2", "\n2 2", "line 12: has 10 values: must be 11"),
        ("lj", "si", "is in LAMMPS's units si, and the case in reduced"),
        (" id type ", " id kind ", "has no column type, by which disks belong to 2 species"),
        ("\n1 1 2.1 1.2 0 7 8 0 0 0 9", "", "has 2 disks: must be 3, the sum of the species' numbers"),
    ],
)  # fmt: skip
def test_mistakes_name_line_value_and_what_is_wanted(old: str, new: str, says: str, tmp_path: Path) -> None:
    if old.startswith("3\n2 2"):
        text = LAMMPS.replace("0 0 3\n3 1", "0 0\n3 1")
    else:
        text = LAMMPS.replace(old, new, 1)
    assert text != LAMMPS
    with pytest.raises(InputError, match=says):
        read(tmp_path, text)


def test_a_case_starts_from_a_frame_of_another_program(toml: Path) -> None:
    """From a run's own frame as extended XYZ, whose numbers are single, and as a dump of the same: the start is that frame."""
    text = case_text(
        {"species[0].number": 30, "species[0].name": "a disk", "run.t_end": 0.1, "box.lengths": [8.0, 6.0]}
    )
    toml.write_text(text.replace("packing_fraction = 0.2\n", ""), encoding="utf-8")
    run, xyz, dump = (toml.with_name(name) for name in ("a.h5", "start.xyz", "start.dump"))
    assert cli.main(["run", str(toml), "-o", str(run), "--no-picture", "--set", "output.views=false"]) == 0
    assert cli.main(["export", str(run), "--to", "extxyz", "--frames=-1", "-o", str(xyz)]) == 0
    with ifrdem.Trajectory(run) as found:
        x, v, w = (found[-1][name].tolist() for name in ("position", "velocity", "angular_velocity"))
    rows = [f"{i + 1} 1 {x[i][0]} {x[i][1]} {v[i][0]} {v[i][1]} {w[i]}" for i in reversed(range(30))]
    head = "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n30\nITEM: BOX BOUNDS pp pp pp\n0 8\n0 6\n0 1\n"
    dump.write_text(
        head + "ITEM: ATOMS id type x y vx vy omegaz\n" + "\n".join(rows) + "\n", encoding="utf-8"
    )
    for file in (xyz, dump):
        changes = [f"start.file={file.name}", "species[0].speed_rms="]
        state = ifrdem.Case.read(toml, set=changes).simulation().state
        assert np.asarray(state.position) == pytest.approx(np.array(x), abs=1e-6)
        assert np.asarray(state.velocity) == pytest.approx(np.array(v), abs=1e-6)
        assert np.asarray(state.spin) == pytest.approx(np.array(w), abs=1e-6)
