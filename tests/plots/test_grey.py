"""Series of a picture differ without colours: in grey print, and for eyes that see none."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import rgb_to_hsv, to_rgb
from matplotlib.figure import Figure
from support import grey

from ifrdem import Box, Disks, State, Trajectory, TrajectoryWriter
from ifrdem.analysis.catalogue import FUNCTIONS
from ifrdem.plots import disks, pictures
from ifrdem.plots.style import KINDS, LOOKS, ROTATION, TRANSLATION, lightness, marked_line

N = 200
LEAST = 10.0  # L* averaged over the inked pixels; the same marker or line in blue and vermilion has 2 to 8 (below)


@pytest.fixture(scope="module")
def mixture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cooling gas of two species that counts every mechanism."""
    path, rng, box = tmp_path_factory.mktemp("grey") / "run.h5", np.random.default_rng(1), Box((40.0, 30.0))
    species = [{"name": name, "number": N // 2, "material": "steel"} for name in ("light", "heavy")]
    law = {"law": "ifr", "e_n": 0.9, "e_t": -0.9, "mu": 0.2}
    parameters = {"laws": json.dumps([[law]]), "species": json.dumps(species)}
    disks = Disks(N, np.repeat([1.0, 3.0], N // 2), np.repeat([0.2, 0.3], N // 2))
    begin, velocity, angle = rng.random((N, 2)) * box.lengths, rng.normal(size=(N, 2)), np.zeros(N)
    with TrajectoryWriter(path, disks, box, parameters=parameters) as file:
        for t in np.arange(10.0):
            T = 2.0 / (1.0 + t)
            spin = rng.normal(size=N)
            state = State(begin + velocity * t, velocity + rng.normal(size=(N, 2)), spin, angle=angle, time=t)
            totals = {
                "temperature": T, "rotational_temperature": 0.5 * T, "collisions": int(1.5 * N * t),
                "translational_energy": N * T, "rotational_energy": 0.25 * N * T, "energy": 1.25 * N * T,
                "dissipated_energy": N * (2.5 - 1.25 * T), "energy_input": t, "wall_work": t, "wall_heat": t,
                "dissipated_by_mechanism": np.arange(1.0, 8.0) * t,
            }  # fmt: skip
            file.write(state, totals)
    return path


KINDS_OF_PICTURES = (
    "temperatures", "energy", "ledger", "mechanisms", "velocity", "rdf", "msd", "vacf", "profiles", "species",
    "velocity-correlation", "vorticity",
)  # fmt: skip


@pytest.mark.full(keep=2)
@pytest.mark.parametrize("what", KINDS_OF_PICTURES)
@pytest.mark.filterwarnings("ignore")
def test_series_of_a_picture_differ_in_grey(mixture: Path, what: str) -> None:
    """T and T_rot had one marker, and greys of L* 46 and 54."""
    with Trajectory(mixture) as run:
        panels = [axes for axes in pictures.figure(run, what).axes if axes.get_visible()]
        least = grey.least_difference(*panels)
    assert LEAST < least < np.inf


def test_kinds_differ_in_grey_and_colours_alone_do_not() -> None:
    def of(*looks: dict[str, object]) -> float:
        axes = Figure().subplots()
        for i, look in enumerate(looks):
            axes.plot([0.0, 1.0], [0.0, 1.0], label=str(i), **look)  # type: ignore[arg-type]
        return grey.least_difference(axes)

    assert len(LOOKS) == len(KINDS) + 1
    assert of(*(marked_line(color) for color in LOOKS)) > LEAST
    for style in ({"ls": "-"}, {"marker": "o", "mfc": "none", "ls": "none"}):
        assert of(*({"color": color, **style} for color in (TRANSLATION, ROTATION))) < LEAST


def test_lightness_is_that_of_tables() -> None:
    """L* of the primaries of sRGB as tables of colours have them (Lindbloom), and of the grey that is half as light."""
    colours = np.array([[0, 0, 0], [255, 255, 255], [119, 119, 119], [255, 0, 0], [0, 255, 0], [0, 0, 255]])
    np.testing.assert_allclose(lightness(colours / 255), [0.0, 100.0, 50.03, 53.24, 87.73, 32.30], atol=0.01)


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("count", [2, 3, 5, 8])
def test_kinds_of_disks_differ_in_grey_and_keep_their_hues(count: int, *, dark: bool) -> None:
    """Large disks of two kinds had greys of L* 54 and 58 (`brazil_nut`); curves of species have the same hues."""
    colours = disks.colour_map("kinds", dark=dark, kinds=count)(np.arange(count))[:, :3]
    steps = np.diff(lightness(colours))
    assert steps.min() > 0.9 * steps.max() > 6.0
    for colour, own in zip(colours, KINDS, strict=False):
        hue, expected = (rgb_to_hsv(to_rgb(each))[0] for each in (colour, own))
        assert to_rgb(own) == (0.6, 0.6, 0.6) or abs(hue - expected) < 0.02


def test_the_energy_of_a_gas_that_cools_is_logarithmic(mixture: Path) -> None:
    with Trajectory(mixture) as run:
        axes = pictures.figure(run, "energy").axes[0]
    assert axes.get_yscale() == "log"
    np.testing.assert_allclose(axes.lines[0].get_ydata(), 2.0 * N / (1.0 + np.arange(10.0)))


def test_there_is_no_error_where_disks_would_overlap(tmp_path: Path) -> None:
    """g is 0 exactly below the sum of the two smallest radii, not 0 within the error of one pair."""
    rng, at = np.random.default_rng(2), np.mgrid[0:20, 0:20].reshape(2, -1).T
    with TrajectoryWriter(tmp_path / "a.h5", Disks(400, 1.0, 0.4), Box((20.0, 20.0))) as file:
        for t in (0.0, 1.0):
            file.write(
                State(at + rng.uniform(-0.09, 0.09, (400, 2)), np.zeros((400, 2)), np.zeros(400), time=t)
            )
    with Trajectory(tmp_path / "a.h5") as run:
        found = FUNCTIONS["rdf"](run, None).result["all disks"]
    step = found.r[1] - found.r[0]
    core = found.r + 0.5 * step <= 0.8
    assert core.sum() > 30
    assert not found.g_error[core].any()
    assert not np.any(found.ends[1][core])
    assert found.g_error[~core].all()
