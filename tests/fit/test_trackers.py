"""Files of tracking programs: their layouts, made here, and what a message says of a wrong one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ifrdem.errors import InputError
from ifrdem.fit import tracks
from ifrdem.tools.tables import TableFormat

TRACKMATE = """\
LABEL,ID,TRACK_ID,QUALITY,POSITION_X,POSITION_Y,POSITION_Z,POSITION_T,FRAME
Label,Spot ID,Track ID,Quality,X,Y,Z,T,Frame
Label,Spot ID,Track ID,Quality,X,Y,Z,T,Frame
,,,(quality),(micron),(micron),(micron),(sec),
ID1,71,0,5.1,250,10000,0,0.5,0
ID2,72,3,5.1,600,20000,0,0.5,0
ID3,73,0,5.1,500,10000,0,0.75,1
"""
DEEPLABCUT = """\
scorer,net,net,net,net,net,net
bodyparts,red,red,red,blue,blue,blue
coords,x,y,likelihood,x,y,likelihood
0,1.5,2.5,0.99,7,8,0.98
1,1.6,2.6,0.99,7,8,0.1
"""
INDIVIDUALS = """\
scorer,net,net,net,net
individuals,a,a,b,b
bodyparts,centre,centre,centre,centre
coords,x,y,x,y
4,1.5,2.5,7,8
"""
TRACKER = "#multi:\n\tmass A\t\tmass B\t\nt\tx\ty\tx\ty\n0.0\t1.5\t2.5\t7\t8\n0.1\t1.6\t2.6\t\t\n"
ONE_MASS = "mass_A\nt\tx\ty\n0.000000000E0\t1.5E0\t2.5E0\n1.0E-1\t1.6E0\t2.6E0\n"
TRACKPY = """\
frame,y,x,mass,size,ecc,signal,raw_mass,ep,frame,particle
0,2.5,1.5,812,2.1,0.1,30,900,0.02,0,0
0,8,7,812,2.1,0.1,30,900,0.02,0,1
1,2.6,1.6,812,2.1,0.1,30,900,0.02,1,0
"""


@pytest.mark.parametrize(
    ("text", "fps", "time", "places"),
    [
        (TRACKMATE, None, [0.5, 0.75], {0: [[2.5e-4, 1e-2], [5e-4, 1e-2]], 3: [[6e-4, 2e-2]]}),
        (DEEPLABCUT, 10.0, [0.0, 0.1], {0: [[1.5, 2.5], [1.6, 2.6]], 1: [[7.0, 8.0]]}),
        (INDIVIDUALS, 10.0, [0.4], {0: [[1.5, 2.5]], 1: [[7.0, 8.0]]}),
        (TRACKER, None, [0.0, 0.1], {0: [[1.5, 2.5], [1.6, 2.6]], 1: [[7.0, 8.0]]}),
        (TRACKER.replace("\t", ";"), None, [0.0, 0.1], {0: [[1.5, 2.5], [1.6, 2.6]], 1: [[7.0, 8.0]]}),
        (TRACKER.replace(".", ","), None, [0.0, 0.1], {0: [[1.5, 2.5], [1.6, 2.6]], 1: [[7.0, 8.0]]}),
        (ONE_MASS, None, [0.0, 0.1], {0: [[1.5, 2.5], [1.6, 2.6]]}),
        (TRACKPY, 10.0, [0.0, 0.1], {0: [[1.5, 2.5], [1.6, 2.6]], 1: [[7.0, 8.0]]}),
    ],
    ids=[
        "TrackMate",
        "DeepLabCut",
        "individuals",
        "Tracker",
        "Tracker ;",
        "Tracker 0,1",
        "one mass",
        "Trackpy",
    ],
)
def test_layouts_are_read(
    text: str, fps: float | None, time: list[float], places: dict[int, list[list[float]]], tmp_path: Path
) -> None:
    """TRACK_ID, not ID, is the disk; a position that DeepLabCut is not sure of, and an empty one, are missing.

    After `trackpy.filter_stubs` the index of a table is its column frame, which pandas writes twice.
    """
    path = tmp_path / "tracks.csv"
    path.write_text(text, encoding="utf-8")
    found = tracks.read(path, fps=fps)
    assert {*found.position} == {*places}
    np.testing.assert_allclose(found.time[0], time)
    for one, each in places.items():
        np.testing.assert_allclose(found.position[one], each)
    assert found.note.startswith("a file of ")
    assert found.source == str(path)


def test_frames_of_openptv_are_linked_by_rows(tmp_path: Path) -> None:
    """Rows 0 and 1 change places in the second frame, in which a third disk appears; one is left in the third."""
    frames = {
        100: "2\n-1 1 10 20 0\n-1 0 30 40 0\n",
        101: "3\n1 -2 31 41 0\n0 0 11 21 0\n-1 -2 50 60 0\n",
        102: "1\n1 -2 12 22 0\n",
    }
    for frame, text in frames.items():
        (tmp_path / f"ptv_is.{frame}").write_text(text, encoding="utf-8")
    found = tracks.read(tmp_path, fps=10.0)
    np.testing.assert_allclose(found.position[0], [[0.010, 0.020], [0.011, 0.021], [0.012, 0.022]])
    np.testing.assert_allclose(found.position[1], [[0.030, 0.040], [0.031, 0.041]])
    np.testing.assert_allclose(found.time[2], [10.1])
    with pytest.raises(InputError, match="is one frame of OpenPTV; give the folder"):
        tracks.read(tmp_path / "ptv_is.100", fps=10.0)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (DEEPLABCUT.replace("1.6", "abc"), r"line 5: x of red = abc: must be a number"),
        (TRACKER.replace("2.6", "abc"), r"line 5: y of mass A = abc: must be a number"),
        (TRACKMATE.replace("20000", "abc"), r"\(of TrackMate\): line 6: y = abc: must be a number"),
        (DEEPLABCUT, "requires fps"),
        (DEEPLABCUT + 9 * "2,a,b,1,7,8,0.98\n", "and 13 more mistakes like these"),
        ("#multi:\n", "is a file of Tracker without values"),
        (
            DEEPLABCUT.replace("bodyparts,red,red,red,blue,blue,blue", "bodyparts,red"),
            "column y: has no value",
        ),
    ],
)
def test_wrong_values_are_named_by_their_line(text: str, says: str, tmp_path: Path) -> None:
    (tmp_path / "tracks.csv").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=says):
        tracks.read(tmp_path / "tracks.csv")


def test_units_and_columns_by_the_names_of_the_file(tmp_path: Path) -> None:
    """--unit px=mm needed the name x; --column px=x was no such quantity."""
    path = tmp_path / "own.csv"
    path.write_text("t,disk,px,py (cm)\n0,1,250,3\n1,1,260,3\n", encoding="utf-8")
    form = TableFormat(columns={"px": "x", "y": "py (cm)"}, units={"px": "mm", "py": "0.5"})
    np.testing.assert_allclose(tracks.read(path, form=form).position[1], [[0.25, 1.5], [0.26, 1.5]])
    with pytest.raises(InputError, match="unit pz: no such quantity"):
        tracks.read(path, form=TableFormat(columns={"x": "px", "y": "py (cm)"}, units={"pz": "mm"}))


def test_mistakes_of_one_kind_are_listed_five_times(tmp_path: Path) -> None:
    path = tmp_path / "wrong.csv"
    rows = [f"{i},1,1,w{i}\n" for i in range(300)]
    path.write_text("t,id,x,y\n" + "".join(rows) + "300,1,b,2\n", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        tracks.read(path)
    *listed, last, more = str(caught.value).splitlines()
    assert [line.rsplit(": ", 2)[1] for line in listed] == [f"y = w{i}" for i in range(5)]
    assert last.endswith("line 302: x = b: must be a number")
    assert more.endswith("295 more lines: y: must be a number")
