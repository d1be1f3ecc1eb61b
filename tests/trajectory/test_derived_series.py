"""Quantities of the whole gas that follow from stored ones: collisions per disk, collision rate, theta."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ifrdem
from ifrdem.runs.info import describe


def two_disks(path: Path) -> ifrdem.Trajectory:
    """Two disks at t = 0, 2 and 3 after 0, 3 and 4 collisions of a pair each, with T_rot = T / 2, at rest at last."""
    disks, box = ifrdem.Disks(2, mass=1.0, radius=0.5), ifrdem.Box((10.0, 10.0))
    with ifrdem.TrajectoryWriter(path, disks, box) as file:
        for time, collisions, T in ((0.0, 0, 1.0), (2.0, 3, 0.5), (3.0, 4, 0.0)):
            state = ifrdem.State([[1.0, 5.0], [4.0, 5.0]], np.zeros((2, 2)), np.zeros(2), time=time)
            observables = {"temperature": T, "rotational_temperature": 0.5 * T, "collisions": collisions}
            file.write(state, observables)
            file.write_series(
                time, {**observables, "species_temperature": [T, T], "species_rotational_temperature": [T, 0.25 * T]},
                {"species_temperature": ("a", "b"), "species_rotational_temperature": ("a", "b")},
            )  # fmt: skip
    return ifrdem.Trajectory(path)


def test_derived_quantities(tmp_path: Path) -> None:
    with two_disks(tmp_path / "a.h5") as run:
        for source in (run.series, run.observables):
            np.testing.assert_array_equal(source["collisions_per_disk"], [0.0, 3.0, 4.0])
            np.testing.assert_array_equal(source["collision_rate"], [np.nan, 1.5, 1.0])
            np.testing.assert_array_equal(source["theta"], [0.5, 0.5, np.nan])
            assert "theta" not in source  # it is not stored
        np.testing.assert_array_equal(run.series["species_theta/b"], [0.25, 0.25, np.nan])
        with pytest.raises(ifrdem.InputError, match="no column 'c'"):
            run.series["species_theta/c"]
        table, data = run.to_pandas("series"), run.to_xarray()
        assert list(table.collision_rate[1:]) == [1.5, 1.0]
        assert list(table.species_theta_b[:2]) == [0.25, 0.25]
        assert data.series_species_theta.dims == ("series_time", "species")
        np.testing.assert_array_equal(data.observables_theta, [0.5, 0.5, np.nan])
        np.testing.assert_array_equal(data.series_collisions_per_disk, [0.0, 3.0, 4.0])


def test_unknown_quantities_are_refused(tmp_path: Path) -> None:
    disks, box = ifrdem.Disks(1, mass=1.0, radius=0.5), ifrdem.Box((10.0, 10.0))
    with ifrdem.TrajectoryWriter(tmp_path / "b.h5", disks, box) as file:
        file.write(ifrdem.State([[1.0, 5.0]], [[0.0, 0.0]], [0.0]), {"temperature": 1.0})
    with ifrdem.Trajectory(tmp_path / "b.h5") as run:
        assert run.observables.derived == ()
        with pytest.raises(ifrdem.InputError, match="no observable 'theta'"):
            run.observables["theta"]


def test_info_separates_long_names_from_their_types(tmp_path: Path) -> None:
    with two_disks(tmp_path / "c.h5") as run:
        path = run.path
    lines = describe(path).splitlines()
    for name in ("species_temperature", "species_rotational_temperature"):
        (line,) = (one for one in lines if one.startswith(f"  {name} "))
        assert line.split()[1].startswith("float64")
