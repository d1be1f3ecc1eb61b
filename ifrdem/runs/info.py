"""Content of a trajectory file, as text for people."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np

from ..case.summary import size
from ..errors import InputError, counted, printable
from ..model.box import describe_sides
from ..tools.files import checkpoint_of
from ..tools.versions import described
from ..trajectory import damage, layout, views
from ..trajectory.reader import Trajectory
from . import status


def describe(path: str | os.PathLike[str], *, full: bool = False) -> str:
    """Content of a trajectory file, as text for people; `full` gives long parameters (the case text) whole.

    Raises InputError as `Trajectory`.
    """
    with Trajectory(path) as trajectory:
        lines = [f"{path}: trajectory of ifrdem, H5MD {'.'.join(map(str, layout.H5MD_VERSION))}"]
        lines += [f"  {name:<18}{text}" for name, text in _gas(trajectory)]
        for describe in (_describe_fields, _describe_series, _describe_histories, _describe_files):
            lines += describe(trajectory)
        lines += _describe_names("units", trajectory.units, full=full)
        record = {name: each for name, each in trajectory.parameters.items() if name.split("/")[0] != "units"}
        lines += _describe_names("parameters", record, full=full)
    return printable("\n".join(lines))


def _gas(trajectory: Trajectory) -> Iterator[tuple[str, str]]:
    box, times, units = trajectory.box, trajectory.times, trajectory.units
    length, time, mass = (f" {units[name]}" if name in units else "" for name in ("length", "time", "mass"))
    yield "size on disk", size(trajectory.path.stat().st_size)
    record = trajectory.parameters
    yield "written by", described(record.get("versions/ifrdem"), record.get("git"))
    if (parts := trajectory.parts) is not None:
        for number in range(len(parts)):
            own, part_path = parts.disks(number), parts.path_of(trajectory.path, number)
            stored = "MISSING" if number in trajectory.missing else size(part_path.stat().st_size)
            held = f"disks {own.start} to {own.stop - 1}, {stored}"
            yield "" if number else f"{counted(len(parts), 'part')}", f"{parts.name(number)}: {held}"
    span = f", time {times[0]:.6g} to {times[-1]:.6g}{time}" if len(times) else ""
    yield "frames", f"{len(trajectory)}{span}"
    if not units:
        yield "units", str(trajectory.parameters.get("units", "not stated"))
    part = trajectory.part
    if part is not None:
        end = part.first + trajectory.n - 1
        yield (
            "part",
            f"{part.number} of a trajectory, whose NAME.h5 shows all of it: disks {part.first} to {end}",
        )
    yield "disks", str(trajectory.n)
    if trajectory.n and not trajectory.missing:
        disks = trajectory.disks
        for name, unit in (("radius", length), ("mass", mass), ("k", "")):
            values = getattr(disks, name)
            ends = dict.fromkeys((f"{values.min():.6g}", f"{values.max():.6g}"))
            yield name, " to ".join(ends) + unit
        yield "materials", str(len(np.unique(disks.material)))
    if box.is_open:
        yield "box", "open: positions are plain, never wrapped"
    else:
        yield "box", f"{box.lengths[0]:.6g} x {box.lengths[1]:.6g}{length}, {describe_sides(box)}"
    if trajectory.walls:
        shapes = Counter(wall.shape for wall in trajectory.walls)
        yield "walls", ", ".join(f"{count} {shape}" for shape, count in shapes.items())
    if not box.is_open and part is None and not trajectory.missing:
        free_area = trajectory.free_area
        phi = free_area.packing_fraction(trajectory.disks.radius)
        yield "packing fraction", f"{phi:.4f}{free_area.name}"


def _describe_fields(trajectory: Trajectory) -> list[str]:
    lines = ["fields (per disk and frame)"]
    for name in trajectory.fields:
        with damage.as_damage_error(trajectory.path, name):
            if trajectory.missing:
                lines.append(f"  {name:<18}{trajectory.dtype(name)}")
                continue
            dataset = trajectory.dataset(name)
            held = [
                (file[dataset.name].id.get_storage_size(), damage.compression(file[dataset.name]))
                for file in trajectory.data_files()
            ]
            filters = f", {held[0][1]}" if held[0][1] else ""
            stored = size(sum(each for each, _ in held))
        frame = int(np.prod(dataset.shape[1:])) * dataset.dtype.itemsize
        stored_text = f"{size(frame)} a frame, {stored} stored{filters}"
        lines.append(f"  {name:<18}{dataset.dtype}{_shape(dataset.shape[2:])}, {stored_text}")
        if len(dataset) > len(trajectory):
            lines[-1] += f", {len(dataset) - len(trajectory)} uncommitted"
    lines.append("observables (per frame)")
    width = _width(trajectory.observables)
    for name, values in trajectory.observables.items():
        lines.append(f"  {name:<{width}}{values.dtype}{_shape(values.shape[1:])}")
    return lines


def _width(names: Iterable[str]) -> int:
    """Width of a column of names, with a space at its end at least."""
    return max([24, *(len(name) + 1 for name in names)])


def _describe_series(trajectory: Trajectory) -> list[str]:
    series, lines = trajectory.series, []
    if len(series):
        rows = len(series.time)
        span = f", time {series.time[0]:.6g} to {series.time[-1]:.6g}" if rows else ""
        lines.append(f"series ({rows} rows{span})")
        width = _width(series)
        for name in series:
            value, columns = series[name], series.columns(name)
            named = f": {', '.join(columns)}" if columns else ""
            lines.append(f"  {name:<{width}}{value.dtype}{_shape(value.shape[1:])}{named}")
    if "ledger_residual" in series and len(series.time):
        # What was there at the start and was put in since, less what was dissipated and what is there.
        worst, *parts = (
            float(np.max(np.abs(series[name])))
            for name in ("ledger_residual", "energy", "dissipated_energy", "energy_input", "wall_work")
            if name in series
        )
        scale = max(parts, default=0.0)
        share = f", {worst / scale:.1e} of the largest energy in it" if scale > 0.0 else ""
        lines.append(f"energy balance: largest error {worst:.3g}{trajectory.with_unit('', 'energy')}{share}")
    return lines


def _describe_histories(trajectory: Trajectory) -> list[str]:
    ids = trajectory.tracked
    if len(ids) == 0:
        return []
    events, start, end = trajectory.tracked_events
    some = ", ".join(map(str, ids[:8])) + (", ..." if len(ids) > 8 else "")
    until = trajectory.with_unit(f"{end:.6g}", "time")
    heading = f"histories of {len(ids)} disk{'s' * (len(ids) != 1)} ({some})"
    return [heading, f"  events            {events}, time {start:.6g} to {until}"]


def _describe_files(trajectory: Trajectory) -> list[str]:
    """Files that belong to the trajectory."""
    path, lines = trajectory.path, []
    checkpoint = checkpoint_of(path)
    if checkpoint.exists():
        lines.append(f"  checkpoint        {checkpoint.name} ({size(checkpoint.stat().st_size)})")
    status_path = status.path_of(path)
    if status_path.exists():
        lines.append(f"  status            {status_path.name}: {_status(status_path)}")
    stale = views.stale(path)
    for view in views.paths(path):
        if view.exists():
            old = ", older than the trajectory: `ifrdem link` renews it" if view in stale else ""
            lines.append(f"  link              {view.name}{old}")
    return ["files next to it", *lines] if lines else []


def _status(path: Path) -> str:
    try:
        found = status.read(path)  # which knows whether the run's process is there still
    except InputError as error:  # the trajectory is none the worse for it
        return str(error)
    state, message = str(found["state"]), str(found.get("message") or "")
    return f"{state}, {message}" if message else state


def _describe_names(title: str, names: Mapping[str, object], *, full: bool) -> list[str]:
    lines = [title] if names else []
    for name, value in names.items():
        text = str(value).rstrip("\n")
        rows = text.splitlines()
        if len(rows) <= 1 and (full or len(text) <= 80):
            lines.append(f"  {name:<20}{text}")
        elif full:
            lines += [f"  {name}", *(f"    {row}" for row in rows)]
        else:
            lines.append(f"  {name:<20}{rows[0][:50]} ... ({len(rows)} lines, {len(text)} characters)")
    return lines


def _shape(shape: tuple[int, ...]) -> str:
    return f" x {' x '.join(map(str, shape))}" if shape else ""
