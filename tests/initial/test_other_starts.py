"""Start files of other programs are refused with the columns that are wanted."""

from __future__ import annotations

from pathlib import Path

import pytest

from ifrdem.errors import InputError
from ifrdem.initial import from_csv

LAMMPS = """\
ITEM: TIMESTEP
0
ITEM: NUMBER OF ATOMS
2
ITEM: BOX BOUNDS pp pp pp
-1 1
-1 1
-0.1 0.1
ITEM: ATOMS id type x y z vx vy vz omegax omegay omegaz
2 1 0.5 0.5 0 1 0 0 0 0 3
1 2 0.1 0.1 0 1 0 0 0 0 3
"""
XYZ = '2\nLattice="2 0 0 0 2 0 0 0 1" Properties=species:S:1:pos:R:3:velo:R:3 pbc="T T F"\nA 0.5 0.5 0 1 0 0\nB 0.1 0.1 0 1 0 0\n'


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (
            LAMMPS,
            r"is a dump of LAMMPS with columns id, type, x, .*: must be CSV; write columns x from x, y from y, vx from vx, "
            r"vy from vy, spin from omegaz, with rows sorted by type, as the species of the case, and then by id; "
            r"subtract the lower bounds of the box from x and y$",
        ),
        (
            XYZ,
            r"is extended XYZ with columns species, pos_x, .*: must be CSV; write columns x from pos_x, y from pos_y, "
            r"vx from velo_x, vy from velo_y \(and spin, which it does not have, or no motion at all\), with rows sorted by "
            r"species, as the species of the case, and then by id$",
        ),
    ],
)
def test_other_formats_are_refused_with_their_columns(text: str, says: str, tmp_path: Path) -> None:
    """A dump of LAMMPS had no header, and "ITEM: TIMESTEP" was an unknown column."""
    (tmp_path / "start.csv").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=says):
        from_csv.read(tmp_path / "start.csv", 2)
