"""Coverage of intervals over sets of tracks of `track_simulator`, from the frames of a video to the coefficients.

Run from the root of the repository by `PYTHONPATH=tests python -m support.track_coverage --sets 200`. Each
set is a film of 20 disks of two materials in a walled tray, whose walls are given; `--trays` chooses how it slows them
down. A line of each set goes to `--out`
at once, so that a study can be stopped and continued; `--show` prints the table of such files. An interval holds the
truth if the loss, with the coefficient held at its true value, has risen by less than the quantile, as in
`ifrdem.validation.fit_coverage`.
"""

from __future__ import annotations

import argparse
import itertools
import json
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ifrdem import fit
from ifrdem.fit import impacts, tracks
from ifrdem.fit.laws import LAWS
from ifrdem.fit.likelihood import NU, Likelihood
from ifrdem.fit.maximum import Search, rise_of
from ifrdem.model.walls.wall import Wall

from . import track_simulator as simulator

X, Y = simulator.TRAY
WALLS = [
    Wall.line((0, 0), (1, 0)),
    Wall.line((0, 0), (0, 1)),
    Wall.line((X, Y), (-1, 0)),
    Wall.line((X, Y), (0, -1)),
]
DISKS = {i: fit.Disk(mass=simulator.MASS[i % 2], radius=simulator.RADIUS[i % 2]) for i in range(20)}
LAW = "ifr-percussion"
LEVELS = (0.68, 0.95)
LEAST = 6  # impacts of a fit


SLIDING: dict[str, Any] = {"speed": 1.0, "spin": 10.0}
TRAYS: dict[str, tuple[simulator.Tray | None, dict[str, Any], int, float]] = {
    "none": (None, {}, 1, 6.0),
    "air": (simulator.Tray(0.02, 0.03, 0.1, 0.03), {}, 1, 6.0),
    "tilted": (simulator.Tray(0.02, 0.03, 0.1, 0.03, (0.05, -0.02)), {}, 1, 6.0),
    "plain": (simulator.Tray(2.0, 0.0, 80.0), SLIDING, 14, 0.8),
    "coins": (simulator.Tray(2.0, contact="face"), SLIDING, 14, 0.8),
    "edges": (simulator.Tray(2.0, contact="ring"), SLIDING, 14, 0.8),
    "two frictions": (simulator.Tray(2.0, contact="face", slippery=0.8), SLIDING, 14, 0.8),
    "resting": (simulator.Tray(2.0, contact="face"), {"speed": 1.4, "spin": 10.0, "resting": 12}, 20, 0.8),
}
"""Trays, starts, numbers of clips and their durations [s], by name; 12 of 20 disks of "resting" are at rest at first."""


def film_of(name: str, fps: float, seed: int) -> str:
    """A film of a tray, a second between its clips; a hundredth of the positions is lost."""
    tray, start, number, duration = TRAYS[name]
    each = [simulator.simulate(fps, duration, 1000 * seed + i, tray=tray, **start) for i in range(number)]
    return simulator.film(simulator.clips(each, round(fps) / fps), seed, lost=0.01)


def tables(tray: str, fps: float, seed: int, folder: Path) -> Iterator[tuple[str, fit.Collisions]]:
    """Tables of the impacts found in one film, by the pair of materials."""
    (folder / "tracks.csv").write_text(film_of(tray, fps, seed), encoding="utf-8")
    found = impacts.find(tracks.read(folder / "tracks.csv", fps=fps), DISKS, walls=WALLS)
    for columns, wall in ((found.pairs, False), (found.walls, True)):
        (folder / "hits.csv").write_text(impacts.csv(columns), encoding="utf-8")
        data = fit.read(folder / "hits.csv")
        assert isinstance(data, fit.Collisions)
        if wall:
            yield "wall", data
            continue
        for part in data.kinds():
            masses = (float(np.asarray(disk.mass)[0]) for disk in (part.disk_1, part.disk_2))
            yield "".join(sorted("AB"[simulator.MASS.index(mass)] for mass in masses)), part


TRUTH = {"AA": (0, 0), "AB": (0, 1), "BB": (1, 1)}


def comparison(data: fit.Collisions, truth: Sequence[float], robust: float | None) -> dict[str, object]:
    """Pulls of the coefficients, and the rises of the loss at the truth over those at the ends of the intervals."""
    law = LAWS[LAW]
    search = Search(Likelihood(data.problem(), law, robust))
    true = np.array(truth)
    values, loss = min((search.descend(start) for start in search.near(true)), key=lambda each: each[1])
    ratios = search.variance_ratios(values)
    errors = [error for _, error, _ in search.quantities(values).values()]
    held = []
    for name, value in zip(law.free, truth, strict=True):
        rise = search.descend(values, {name: value})[1] - loss
        held.append([rise / (ratios[name] * rise_of(search, level)) for level in LEVELS])
    pulls = [(a - b) / error for a, b, error in zip(values.tolist(), truth, errors, strict=False)]
    points = search.points(values)
    dof = int(np.sum(search.likelihood.problem.redundancy)) - len(values)
    return {"n": len(data), "chi2": float(np.sum(points.distance)), "dof": dof, "pulls": pulls, "rises": held}


def of_set(tray: str, fps: float, seed: int, *, with_robust: bool) -> dict[str, object]:
    """Chi-square, deviations and coverage of the fits of one film, by pair and kind of fit."""
    found: dict[str, object] = {"tray": tray, "fps": fps, "seed": seed}
    with tempfile.TemporaryDirectory() as folder:
        for pair, data in tables(tray, fps, seed, Path(folder)):
            truth = simulator.WALL if pair == "wall" else simulator.PAIR[TRUTH[pair]]
            for name, nu in (("plain", None), ("robust", NU)) if with_robust else (("plain", None),):
                found[f"{pair} {name}"] = comparison(data, truth, nu)
    return found


def shown(files: Sequence[Path]) -> Iterator[str]:
    """Lines of the table of coverage: the parts of the 68 % and the 95 % intervals that hold the truth.

    Pairs of too few impacts for a fit of three coefficients are left out.
    """
    sets = [json.loads(line) for path in files for line in path.read_text(encoding="utf-8").splitlines()]
    yield "| tray | frames/s | fit | films | impacts | chi2 / dof | pull | largest of e_n | e_n | e_t | mu | all |"
    yield "|---|---|---|---|---|---|---|---|---|---|---|---|"
    groups: dict[tuple[str, str, str], list[dict[str, Any]]] = {}
    for each in sets:
        for key, row in each.items():
            if isinstance(row, dict) and "pulls" in row and row["n"] >= LEAST:
                for tray in (each["tray"], "all"):
                    for fps in (f"{each['fps']:g}", "all"):
                        groups.setdefault((tray, fps, key.split()[1]), []).append(row)
    for (tray, fps, kind), rows in sorted(groups.items(), key=lambda each: (each[0][0] == "all", *each[0])):
        inside = np.array([row["rises"] for row in rows]) < 1.0  # (fit, coefficient, level)
        pulls = np.array([row["pulls"] for row in rows])[:, :3]
        chi2 = np.sum([row["chi2"] for row in rows]) / np.sum([row["dof"] for row in rows])
        films = len(
            {
                (each["tray"], each["fps"], each["seed"])
                for each in sets
                if tray in (each["tray"], "all") and fps in (f"{each['fps']:g}", "all")
            }
        )
        cells = [
            f"{low:.3f}, {high:.3f}" for low, high in (*np.mean(inside, axis=0), np.mean(inside, axis=(0, 1)))
        ]
        pull, largest = np.sqrt(np.mean(pulls**2)), np.max(np.abs(pulls[:, 0]))
        n = np.sum([row["n"] for row in rows]) / films
        yield f"| {tray} | {fps} | {kind} | {films} | {n:.0f} | {chi2:.3f} | {pull:.2f} | {largest:.1f} | {' | '.join(cells)} |"


def main() -> None:
    """Run sets, or print their table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", type=int, default=200)
    parser.add_argument("--first", type=int, default=1, help="seed of the first set")
    parser.add_argument("--trays", nargs="+", choices=[*TRAYS], default=[*TRAYS])
    parser.add_argument("--fps", type=float, nargs="+", default=[60.0, 120.0, 240.0])
    parser.add_argument("--robust", action="store_true", help="robust fits too")
    parser.add_argument("--out", type=Path, default=Path("track_coverage.jsonl"))
    parser.add_argument("--show", type=Path, nargs="+", metavar="FILE")
    options = parser.parse_args()
    if options.show:
        print("\n".join(shown(options.show)))
        return
    for seed in range(options.first, options.first + options.sets):
        for tray, fps in itertools.product(options.trays, options.fps):
            line = json.dumps(of_set(tray, fps, seed, with_robust=options.robust))
            with options.out.open("a", encoding="utf-8") as file:
                file.write(line + "\n")


if __name__ == "__main__":
    main()
