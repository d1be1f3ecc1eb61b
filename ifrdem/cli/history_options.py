"""The verb `ifrdem history`."""

from __future__ import annotations

import argparse
from typing import Any

SHOWN = 10  # collisions that are printed


def add_to(verbs: Any) -> None:
    """Add the verb."""
    parser = verbs.add_parser(
        "history",
        help="say what a tracked disk did: its collisions",
        description="The history of a tracked disk: its collisions with times, partners, places, velocities, spins, "
        "impulses, angles and regimes. Prints a summary and the latest ten, and writes all with -o.",
        allow_abbrev=False,
    )
    parser.add_argument("file", metavar="FILE", help="a trajectory (.h5) of a run with output.histories")
    parser.add_argument("--id", metavar="ID", required=True, help="id of the disk, from 0")
    parser.add_argument("-o", "--output", metavar="CSV", help="file to write: a line an event, every digit")
    parser.add_argument("--force", action="store_true", help="replace a file that exists")
    parser.set_defaults(act=act)


def act(options: argparse.Namespace) -> int:
    """Do it."""
    from ..tools.arguments import whole
    from ..trajectory import export
    from ..trajectory.reader import Trajectory
    from .export import place

    disk = whole("--id", options.id, 0)
    with Trajectory(options.file) as trajectory:
        history = trajectory.history(disk)
        out = None if options.output is None else place(options, ".csv")
        for line in summary(trajectory, history):
            print(line, flush=True)
    if out is not None:
        export.write_history(history, out)
        print(f"wrote {out}: {len(history)} events", flush=True)
    return 0


def summary(trajectory: Any, history: Any) -> list[str]:
    """A disk's history in some lines."""
    import numpy as np

    from ..trajectory.history import KICK

    def time(value: float) -> str:
        return str(trajectory.with_unit(f"{value:.6g}", "time"))

    kicks = len(history) - history.collisions
    walls = int((history.partner < KICK).sum())
    lines = [
        f"disk {history.disk}: {history.collisions} collisions from t = {history.start:.6g} to {time(history.end)}"
        + (f", {walls} of them with walls" if walls else "")
        + (f"; {kicks} kicks by forces" if kicks else "")
    ]
    if history.collisions > 1:
        lines.append(f"  mean free time {time(history.mean_free_time)}")
    # Kicks would fill the list of a driven disk.
    shown = np.flatnonzero(history.partner != KICK)[-SHOWN:]
    if len(shown):
        if len(shown) < history.collisions:
            lines.append(f"  the latest {len(shown)} (-o writes all; psi in rad):")
        header = f"  {'time':>14} {'partner':>8} {'regime':<20} {'psi':>7} {'P_n':>11} {'P_t':>11} {'spin after':>12}"
        lines.append(header)
        units = trajectory.units
        if "time" in units:
            momentum, angle = (f"({units[one]})" if one in units else "" for one in ("momentum", "angle"))
            time_unit, spin = f"({units['time']})", f"({units.get('angle', 'rad')}/{units['time']})"
            lines.append(
                f"  {time_unit:>14} {'':>8} {'':<20} {angle:>7} {momentum:>11} {momentum:>11} {spin:>12}"
            )
    for i in shown:
        partner = int(history.partner[i])
        who = str(partner) if partner >= 0 else f"wall {-2 - partner}"
        impulse = history.impulse[i]
        lines.append(
            f"  {history.time[i]:>14.8g} {who:>8} {regime(int(history.regime[i])):<20} {history.psi[i]:>7.4f} "
            f"{impulse[0]:>11.4g} {impulse[1]:>11.4g} {history.columns['spin_after'][i]:>12.5g}"
        )
    return lines


def regime(number: int) -> str:
    """A regime in words."""
    from ..model.ifr import Regime

    special = {-1: "not known", 0: "-", 9: "elastic"}
    if number not in special and number not in [*Regime]:
        return f"{number}?"
    return special.get(number) or Regime(number).name.lower().replace("_", " ")
