"""Comparison of a run with measured positions, with the spread from errors of the start and of the law."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..analysis import motion
from ..case import file as case_file
from ..case import starts
from ..case.case import CaseSections
from ..case.gas import CaseGas
from ..errors import InputError, cut, option_name, refuse
from ..fit.figure import save
from ..initial import from_trajectory
from ..model.box import Box
from ..model.laws.ifr import COEFFICIENTS, REQUIRED_COEFFICIENTS, EnergyWarning, IFRLaw
from ..model.state import State
from ..model.walls.wall import Wall, sides
from ..plots.disks import draw_walls
from ..simulation.simulation import Simulation
from ..simulation.start.overlaps import relax
from ..tools import tables
from ..tools.colours import BLUE, VERMILION
from ..tools.old_words import present_case
from ..tools.tables import TableFormat
from ..trajectory.reader import Trajectory

Array = NDArray[np.float64]

KINDS = {"id": "number", "t": "time", "x": "length", "y": "length", "angle": "angle"}
_SPELLINGS = {
    **{name: name for name in KINDS},
    "time": "t",
    "disk": "id",
    "track": "id",
    "orientation": "angle",
}
LEAST_MEMBERS = 4
"""Smallest number of runs with drawn start and law for a covariance."""
MOST_NAMED = 500
"""Measured positions that a figure labels at most; more labels would cover each other."""

_NUMBERS = tuple(name for name in COEFFICIENTS if name != "sticking")


@dataclass(frozen=True, eq=False)
class Measured:
    """Measured positions."""

    id: NDArray[np.int64]  # (m,): disks, by their number in the run
    time: Array  # (m,): times [time]; infinite for the end
    position: Array  # (m, 2): centres [length]
    error: Array  # (m, 2): their standard errors [length]
    angle: Array  # (m,): angle by which a disk has turned [rad]; NaN where it was not measured
    angle_error: Array  # (m,): [rad]


def read(path: Path | str, errors: Mapping[str, float], form: TableFormat) -> Measured:
    """Read measured positions: a line for each disk, with columns id, x, y; t if not of the end; angle; NAME_error.

    Raises InputError with a line for each thing that is wrong.
    """
    table = tables.read(path, KINDS, _SPELLINGS, form)
    columns, source, n = table.columns, table.source, len(table)
    missing = [name for name in ("id", "x", "y") if name not in columns]
    if missing:
        have = ", ".join((*columns, *table.unused))
        name = f"; name one with {option_name('--column id=NAME', 'TableFormat(columns=...)')}"
        raise InputError(f"{source}: missing column {', '.join(missing)}; there are {have}{name}")
    keep = np.all([~np.isnan(columns[name]) for name in ("id", "x", "y")], axis=0)
    ids = columns["id"]
    problems = [
        f"line {table.line[i]}: id = {ids[i]:g}: must be an integer of 0 or more"
        for i in np.flatnonzero(keep & ((ids != np.round(ids)) | (ids < 0)))
    ]
    if not keep.any():
        problems.append("no line has id, x and y")
    error = [columns.get(f"{name}_error", np.full(n, errors.get("positions", 0.0))) for name in ("x", "y")]
    for name, each in zip("xy", error, strict=True):
        problems += [
            f"line {table.line[i]}: error of {name} = {each[i]:g}: must be a number of 0 or more"
            for i in np.flatnonzero(keep & ~(each >= 0.0))
        ]
    refuse(problems, source)
    blank = np.full(n, math.nan)
    angle = np.radians(columns.get("angle", blank))
    angle_error = np.radians(columns.get("angle_error", np.full(n, errors.get("angles", 0.0))))
    time = columns.get("t", np.full(n, math.inf))
    return Measured(
        ids[keep].astype(np.int64), np.where(np.isnan(time), math.inf, time)[keep],
        np.stack([columns["x"], columns["y"]], axis=-1)[keep], np.stack(error, axis=-1)[keep], angle[keep], angle_error[keep],
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Comparison:
    """Comparison of a run with measured positions."""

    measured: Measured
    position: Array  # (m, 2): places in the run [length]
    angle: Array  # (m,): angles in the run [rad]; NaN if it has none
    members: Array  # (s, m, 2): places in the runs with drawn starts and laws; empty without them
    spread: Array  # (m, 2): their standard deviation; NaN without them
    paths: Array  # (f, n, 2): places of all disks in the frames of the run
    radius: Array  # (n,)
    unit: str  # of lengths, with a blank before it; "" if they are reduced or not stated
    reduced: bool = False  # True if the file states that units are
    box: Box = field(default_factory=Box.open)
    walls: tuple[Wall, ...] = ()
    end: float = math.inf  # time of the last frame [time]

    @property
    def distance(self) -> Array:
        """Distance of run and measurement (m,) [length]."""
        return np.asarray(np.hypot(*(self.measured.position - self.position).T))

    def _away(self) -> tuple[Array, Array, Array]:
        """Offset (m, 2) of the measurement, and the covariances (m, 2, 2) of the runs and of the measurement."""
        n = len(self.members)
        centre = self.members.mean(axis=0) if n else self.position
        offset = self.members - centre
        # That of a further run about the mean of n; the truth is one more of them.
        runs = np.einsum("sma,smb->mab", offset, offset) * (1.0 + 1.0 / max(n, 1)) / max(n - 1, 1)
        return self.measured.position - centre, runs, self.measured.error[:, :, None] ** 2 * np.eye(2)

    @property
    def deviation(self) -> Array:
        """Distance over its standard error of runs and measurement together (m,); NaN where there is none."""
        away, runs, measurement = self._away()
        whole = runs + measurement
        good = np.linalg.det(whole) > 1e-12 * np.trace(whole, axis1=1, axis2=2) ** 2
        squared = np.full(len(away), math.nan)
        squared[good] = np.einsum("ma,ma->m", away[good], _solved(whole[good], away[good]))
        return np.sqrt(squared)

    @property
    def probability(self) -> Array:
        """Probability of a smaller deviation (m,), if the run is right: the ellipse on which the position lies.

        A few runs give their own spread badly. Their part of the variance along the offset, r, leaves
        nu = (n - 1) / r^2 degrees of freedom (Y. Yao, Biometrika 52, 139, 1965), and in two dimensions Hotelling's
        distribution of d^2 is P = 1 - (1 + d^2 / nu)^(-(nu - 1) / 2), that of F = d^2 (nu - 1) / (2 nu) with 2 and
        nu - 1 degrees of freedom, which is 1 - exp(-d^2 / 2) for many runs.
        """
        from scipy.special import fdtr

        away, runs, measurement = self._away()
        squared = self.deviation**2
        good = np.isfinite(squared) & (squared > 0.0)
        part = np.zeros(len(away))
        weight = _solved((runs + measurement)[good], away[good])
        part[good] = np.einsum("ma,mab,mb->m", weight, runs[good], weight) / squared[good]
        nu = max(len(self.members) - 1, 1) / np.maximum(part**2, 1e-12)
        return np.asarray(fdtr(2.0, nu - 1.0, squared * (nu - 1.0) / (2.0 * nu)))

    @property
    def _no_unit(self) -> str:
        return " reduced units" if self.reduced else ""

    def table(self) -> str:
        """The figures as text."""
        m, unit = self.measured, self.unit
        drawn = len(self.members) > 0
        runs = f", {len(self.members)} runs with drawn start and law" if drawn else ""
        lengths = f"lengths in{unit or self._no_unit}, " if unit or self._no_unit else ""
        lines = [f"{len(m.id)} places{runs}; {lengths}angles in degrees"]
        spreads = ["spread x", "spread y"] if drawn else []
        heads = ["disk", "t", "x", "y", "x run", "y run", "distance", *spreads, "/ error"]
        turned = np.isfinite(m.angle) & np.isfinite(self.angle)
        heads += ["turned", "turned run"] if turned.any() else []
        lines.append("".join(f"{head:>12}" for head in heads))
        distance, probability = self.distance, self.probability
        numbers = np.column_stack([m.position, self.position, distance]).T.tolist()
        spread = self.spread.T.tolist() if drawn else []
        times = ["end" if math.isinf(t) else f"{t:.4g}" for t in m.time.tolist()]
        deviation = [f"{value:.2f}" if math.isfinite(value) else "-" for value in self.deviation.tolist()]
        columns = [m.id.tolist(), times, *numbers, *spread, deviation]
        for angle in (m.angle, self.angle) if turned.any() else ():
            degrees = zip(np.degrees(angle).tolist(), turned.tolist(), strict=True)
            columns += [[f"{value:.1f}" if there else "-" for value, there in degrees]]
        texts = len(columns) - 2 - len(numbers) - len(spread)
        row = "%12d%12s" + len(numbers) * "%12.4g" + len(spread) * "%12.3g" + texts * "%12s"
        lines += [row % cells for cells in zip(*columns, strict=True)]
        rms = math.sqrt(float(np.mean(distance**2)))
        radii = rms / float(np.mean(self.radius))
        lines.append(f"root mean square distance {rms:.4g}{unit}, {radii:.3g} radii")
        known = probability[np.isfinite(probability)]
        if len(known):
            inside = (f"the {part} % ellipse {np.mean(known < 0.01 * part):.0%}" for part in (68, 95))
            lines.append(f"within {', within '.join(inside)} of {len(known)} places")
        return "\n".join(lines)

    def csv(self) -> str:
        """The figures as a CSV table."""
        m = self.measured
        columns = {
            "id": m.id, "t": m.time, "x": m.position[:, 0], "y": m.position[:, 1], "x_run": self.position[:, 0],
            "y_run": self.position[:, 1], "distance": self.distance, "spread_x": self.spread[:, 0],
            "spread_y": self.spread[:, 1], "deviation": self.deviation, "probability": self.probability,
            "angle": np.degrees(m.angle), "angle_run": np.degrees(self.angle),
        }  # fmt: skip
        known = {name: np.isfinite(column) for name, column in columns.items()}
        row = ",".join("%.9g" if known[name].all() else "%s" for name in columns)
        cells = [
            column.tolist() if known[name].all() else _texts(column, known[name])
            for name, column in columns.items()
        ]
        lines = (row % each for each in zip(*cells, strict=True))
        return "\n".join((",".join(columns), *lines)) + "\n"

    def draw(self, paths: Sequence[Path]) -> None:
        """Draw the run with its paths and walls, measured positions on top, and ellipses of 95 % of the drawn runs.

        Each measured position is labelled by the id of its disk, and by its time unless that is the end.
        """
        from matplotlib.collections import EllipseCollection
        from matplotlib.figure import Figure

        figure = Figure(figsize=(8.0, 7.6), dpi=200, layout="constrained")
        axes = figure.subplots()
        shown = np.concatenate([self.paths[-1], self.position, self.measured.position])
        jumps = np.any(np.abs(np.diff(self.paths, axis=0)) > 0.5 * np.array(self.box.lengths), axis=2)
        for track, jumped in zip(np.swapaxes(self.paths, 0, 1), jumps.T, strict=True):
            track = np.insert(track, np.flatnonzero(jumped) + 1, math.nan, axis=0)  # no line across the box
            axes.plot(*track.T, color=BLUE, lw=0.5, alpha=0.35, zorder=1)
        size = 2.0 * self.radius
        axes.add_collection(
            EllipseCollection(
                size, size, 0.0, units="xy", offsets=self.paths[-1], transOffset=axes.transData,
                facecolors=f"{BLUE}33", edgecolors=BLUE, linewidths=0.8, zorder=2,
            )
        )  # fmt: skip
        if drawn := len(self.members) >= LEAST_MEMBERS:
            turn = np.linspace(0.0, 2.0 * math.pi, 100)
            nu = len(self.members) - 1
            reach = math.sqrt(nu * (0.05 ** (-2.0 / (nu - 1)) - 1.0))  # `probability` 0.95 of the runs alone
            circle = reach * np.stack([np.cos(turn), np.sin(turn)])
            for centre, covariance in zip(self.members.mean(axis=0), self._away()[1], strict=True):
                values, vectors = np.linalg.eigh(covariance)
                ellipse = vectors * np.sqrt(np.maximum(values, 0.0)) @ circle
                axes.plot(*(centre[:, None] + ellipse), color=BLUE, lw=0.9, ls="--", zorder=3)
        m = self.measured
        (x, y), (dx, dy) = m.position.T, m.error.T
        axes.errorbar(x, y, dy, dx, fmt="x", ms=6, mew=1.6, color=VERMILION, zorder=5)
        axes.set_aspect("equal")
        for one, time, (x, y) in (
            zip(m.id, m.time, m.position, strict=True) if len(m.id) <= MOST_NAMED else ()
        ):
            name = f"{one}" if time >= self.end else f"{one}, t = {time:.3g}"
            axes.annotate(name, (x, y), textcoords="offset points", xytext=(4, 4), fontsize="x-small")
        draw_walls(axes, self, self.end, walls=(*self.walls, *sides(self.box)))
        for spine in axes.spines.values():  # the frame is no side of the box here
            spine.set_linewidth(0.8)
        low, high = shown.min(axis=0), shown.max(axis=0)
        margin = 0.06 * float(np.max(high - low)) + float(self.radius.max())
        of = f" ({(self.unit or self._no_unit).strip()})" if self.unit or self._no_unit else ""
        axes.set(xlabel=f"$x${of}", ylabel=f"$y${of}", aspect="equal")
        axes.set(xlim=(low[0] - margin, high[0] + margin), ylim=(low[1] - margin, high[1] + margin))
        axes.plot([], [], "o", color=BLUE, ms=9, mfc=f"{BLUE}33", label="run: disks at the end, and paths")
        axes.plot([], [], "x", color=VERMILION, ms=7, mew=1.6, label="measured")
        if drawn:
            label = f"95 % ellipses by {len(self.members)} runs with drawn start and law"
            axes.plot([], [], "--", color=BLUE, label=label)
        figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize="small")
        save(figure, paths)


def _texts(column: Array, known: NDArray[np.bool_]) -> list[str]:
    """Cells of a column (m,), empty where no value is known."""
    texts = np.full(len(column), "", dtype=object)
    texts[known] = [f"{value:.9g}" for value in column[known].tolist()]
    return list(texts)


def _solved(matrix: Array, vector: Array) -> Array:
    return np.asarray(np.linalg.solve(matrix, vector[..., None])[..., 0])


def compare(
    run: Path | str,
    measured: Measured,
    *,
    laws: Sequence[Mapping[str, float]] = (),
    errors: Mapping[str, float] | None = None,
    members: int = 0,
    seed: int = 1,
    case: Path | str | None = None,
    progress: Callable[[Sequence[int]], object] | None = None,
) -> Comparison:
    """Compare a run with measured positions, and with runs of drawn starts and laws.

    `laws` are coefficients drawn from a fit (`Fitted.draw`), which replace those of every pair of materials, in turn;
    `errors` standard errors of the start: "positions" [length], "velocities" [length/time], "spins" [rad/time], where
    the start file of the `case` file has no columns of errors (without it, the case is that of the run). There are 0 or
    `LEAST_MEMBERS` and more `members`; `progress` wraps their sequence, as `tqdm` does.

    Raises InputError if the run has no positions, a disk or time that it does not have was measured, or a start cannot
    be drawn.
    """
    errors = dict(errors or {})
    with Trajectory(run) as trajectory:
        n, radius, units = trajectory.n, np.asarray(trajectory.disks.radius), trajectory.units
        reduced = trajectory.stated_units == {}
        if "position" not in trajectory.fields:
            raise InputError(f"{run}: holds no positions")
        times = np.array([frame.time for frame in trajectory])
        paths = np.stack([np.asarray(frame.position, dtype=np.float64) for frame in trajectory])
        angles = np.full((len(times), n), math.nan)
        if "angle" in trajectory.fields:
            angles = np.stack([np.asarray(frame.angle) for frame in trajectory])
        text, overrides = (str(trajectory.parameters.get(key, "")) for key in ("case", "overrides"))
        first = trajectory[0]
        start_state = from_trajectory.of_frame(first)
        times_measured = np.minimum(measured.time, times[-1])
        walls = trajectory[len(times) - 1].walls
        box, between = trajectory.box, not np.isin(times_measured, times).all()
        unwrapped = paths  # without jumps, if a position between two frames is needed
        if between and any(box.periodic):
            unwrapped = np.concatenate([*motion.unwrapped(trajectory, range(len(times)))], axis=1)
    if 0 < members < LEAST_MEMBERS:
        raise InputError(f"members = {members}: must be 0, or {LEAST_MEMBERS} runs and more for a spread")
    problems = [f"disk {one}: the run has disks 0 to {n - 1}" for one in np.unique(measured.id) if one >= n]
    before_end = measured.time <= times[-1] * (1.0 + 1e-9)
    late = np.unique(measured.time[np.isfinite(measured.time) & ~(before_end & (measured.time >= times[0]))])
    problems += [f"t = {t:g}: the run lasts from {times[0]:g} to {times[-1]:g}" for t in late]
    refuse(problems, run, most=20)
    position = _nearest(
        box, measured.position, _between_frames(times, unwrapped, measured.id, times_measured), times_measured
    )
    angle = _between_frames(times, angles, measured.id, times_measured)
    found: list[Array] = []
    if members:
        if case is not None:
            gas = case_file.read(case).gas
        else:
            gas = CaseGas.from_case(_case_of(text, overrides), start=False)
        if gas.n != n:
            raise InputError(f"{case}: has {gas.n} disks, and the run {n}: it is another case")
        errors_given = {} if gas.given is None else gas.given.errors
        gas = replace(gas, given=replace(start_state, errors=errors_given))
        start = starts.start(gas)
        rng = np.random.default_rng(seed)
        sequence = range(members)
        each: Iterator[int] = iter(sequence if progress is None else progress(sequence))  # type: ignore[call-overload]
        for k in each:
            law = laws[k % len(laws)] if laws else None
            state = _drawn(gas, start, errors, rng)
            positions = _positions(_simulation(gas, law, state), measured.id, times_measured)
            found.append(_nearest(box, measured.position, positions, times_measured))
    all_members = np.array(found).reshape(-1, len(measured.id), 2)
    spread = all_members.std(axis=0, ddof=1) if len(found) > 1 else np.full_like(position, math.nan)
    unit = f" {units['length']}" if "length" in units and units["length"] != "reduced" else ""
    return Comparison(
        measured,
        position,
        angle,
        all_members,
        spread,
        paths,
        radius,
        unit,
        reduced,
        box,
        walls,
        float(times[-1]),
    )


def _nearest(box: Box, measured: Array, position: Array, time: Array) -> Array:
    """The periodic images of positions that are nearest to measured ones, both (m, 2) [length], at times (m,)."""
    away = measured - position
    return position + (away - box.minimum_image(away, time))


def _between_frames(times: Array, values: Array, ids: NDArray[np.int64], times_measured: Array) -> Array:
    """Values (F, n, ...) of disks at times that are not before the first, linear between the frames; shape (m, ...)."""
    before = np.clip(np.searchsorted(times, times_measured, side="right") - 1, 0, max(len(times) - 2, 0))
    after = np.minimum(before + 1, len(times) - 1)
    start, last = values[before, ids], times_measured >= times[-1]
    step = np.where(last, 1.0, times[after] - times[before])
    ratio = (times_measured - times[before]).reshape(-1, *[1] * (values.ndim - 2))
    slope = (values[after, ids] - start) / step.reshape(ratio.shape)
    found = np.asarray(slope * ratio + start)
    found[last] = values[-1, ids[last]]
    return found


def _drawn(gas: CaseGas, start: State, errors: Mapping[str, float], rng: np.random.Generator) -> State:
    """The start with errors; the errors of a start file's columns come first."""
    own = {} if gas.given is None else gas.given.errors
    n = len(start.spin)

    def error(name: str, group: str) -> Array:
        return np.asarray(own.get(f"{name}_error", np.full(n, errors.get(group, 0.0))))

    s = np.stack([error("x", "positions"), error("y", "positions")], axis=-1)
    position = start.position + s * rng.standard_normal((n, 2))
    s_v = np.stack([error("vx", "velocities"), error("vy", "velocities")], axis=-1)
    velocity = start.velocity + s_v * rng.standard_normal((n, 2))
    spin = start.spin + error("spin", "spins") * rng.standard_normal(n)
    R = gas.disks.radius
    least = 10.0 * float(np.max(s, initial=0.0)) + 1e-5 * float(np.max(R))
    position = gas.box.wrap(relax(gas.box, R, position, least, time=start.time), start.time)
    return replace(start, position=position, velocity=velocity, spin=spin)


def _case_of(text: str, overrides: str) -> CaseSections:
    """The case that a trajectory holds."""
    if not text:
        raise InputError("the run holds no case, because Python wrote it: no runs can be drawn")
    raw = case_file.parsed(text)
    for assignment in overrides.splitlines():
        case_file.override(raw, assignment)
    case = CaseSections.model_validate(present_case(raw))
    if case.law_files:
        given = option_name("--case FILE", "case = FILE")
        raise InputError(
            f"the run has a law of the program {cut(case.law_files[0], 200)}: {given} names the case whose law is "
            "executed; read the program first if it is not yours"
        )
    return case


def _simulation(gas: CaseGas, law: Mapping[str, float] | None, state: State) -> Simulation:
    """The simulation of a state, with the coefficients `law` in place of those of every pair of materials."""
    if law is not None:
        numbers: dict[str, Any] = {name: float(law[name]) for name in _NUMBERS if name in law}
        drawn = []
        for each in gas.verdicts:
            if not isinstance(each.law, IFRLaw):
                raise InputError(
                    f"laws: law of {each.first} and {each.second} is {each.law}: must be an IFRLaw"
                )
            # The case has said so of its own coefficients.
            with warnings.catch_warnings(action="ignore", category=EnergyWarning):
                drawn.append(each._replace(law=replace(each.law, **numbers)))
        gas = replace(gas, verdicts=tuple(drawn))
    return gas.simulation(state)


def _positions(simulation: Simulation, ids: NDArray[np.int64], times: Array) -> Array:
    """Positions (m, 2) of disks at times."""
    found, order = np.empty((len(ids), 2)), np.argsort(times, kind="stable")
    each, first = np.unique(times[order], return_index=True)
    for time, rows in zip(each, np.split(order, first[1:]), strict=True):
        if time > simulation.time:
            simulation.run(t_end=float(time))
        found[rows] = np.asarray(simulation.state.position)[ids[rows]]
    return found


def read_draws(path: Path | str) -> list[dict[str, float]]:
    """Coefficients that `ifrdem fit --draw` wrote.

    Raises InputError if a column is unknown, a coefficient missing, or a value no number.
    """
    kinds = dict.fromkeys(_NUMBERS, "number")
    table = tables.read(path, kinds, {tables.plain(name): name for name in kinds}, TableFormat())
    missing = [name for name in REQUIRED_COEFFICIENTS if name not in table.columns]
    if missing:
        raise InputError(f"{path}: missing column {', '.join(missing)}; there are {', '.join(table.columns)}")
    return [
        dict(zip(table.columns, map(float, row), strict=True))
        for row in zip(*table.columns.values(), strict=True)
    ]
