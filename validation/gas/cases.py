"""Random cases: `ifrdem check` and the first step of `ifrdem run` agree on each of them.

`random_case` draws cases that look like those of a user: walls of all shapes, at rest or moving, pistons, gates,
thermal walls, gravity, forces, mixtures, shear, open boxes, remedies for collapse, starts of all kinds, and now and
then a value that is 0 or many orders of magnitude off. Kernels are compiled for each set of features, so the sets are
those of `KINDS`. Where `check` accepts a case the run begins (`--max-hours` ends it after its first windows). It may
end by itself where physics ends it: an inelastic collapse without a remedy, or disks that never meet.

By hand, `python -m ifrdem.validation.gas.cases FIRST LAST SEED` prints each disagreement of some of them.
"""

from __future__ import annotations

import contextlib
import io
import json
import random
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ...case import file as case_file
from ...case import report as reporting
from ...case.file import CaseFile
from ...case.summary import REFUSED_HERE
from ...errors import EngineError, InputError, Stopped
from ...runs import run as running
from ...runs.outputs import Outputs
from ...simulation.start import checks
from ..report.registry import Result

QUESTION = "Do check and the first step of a run agree on 2,000 random cases?"
REFERENCE = "each other: what check accepts runs, and nothing ends with a traceback"

KINDS = (
    "plain",
    "mixed",
    "sheared",
    "open",
    "still",
    "moving",
    "pistons",
    "rest",
    "contact_time",
    "histories",
    "f32",
)
"""Sets of features."""
COUNT, QUICK = 2000, 60
ENDS = ("inelastic collapse", "can meet another one any more", "never to meet")
"""Parts of messages of runs that physics ends; the first one without a remedy only."""

Dice = random.Random


def toml(value: Any) -> str:
    """A value as TOML; tables inline."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {toml(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    if isinstance(value, bool | int | float):
        return repr(value).lower()
    return json.dumps(value).replace("\x7f", "\\u007f") if isinstance(value, str) else str(value)


def text_of(case: dict[str, Any]) -> str:
    """A case as the text of a file."""
    return "".join(f"{json.dumps(key)} = {toml(each)}\n" for key, each in case.items())


def about(dice: Dice, size: float, spread: float = 1.0) -> float:
    """A positive number near a size, within a factor 10^spread; seldom one that is far off."""
    far = dice.choice((-30.0, -12.0, -6.0, 6.0, 12.0, 30.0)) if dice.random() < 0.01 else 0.0
    return float(f"{size * 10.0 ** (dice.uniform(-spread, spread) + far):.4g}")


def either(dice: Dice, size: float) -> float:
    """A number near a size of either sign, or 0."""
    return dice.choice((-1.0, 1.0, 1.0, 0.0)) * about(dice, size)


def seldom(dice: Dice, part: float = 0.3) -> bool:
    """True in this part of all cases."""
    return dice.random() < part


def law(dice: Dice) -> dict[str, Any]:
    """Coefficients, mostly admissible ones."""
    found: dict[str, Any] = {
        "e_n": dice.choice((0.0, 0.3, 0.7, 0.9, 0.9, 1.0, 1.0, 1e-14)),
        "e_t": dice.choice((-1.0, -1.0, -0.9, -0.9, -0.6)) if seldom(dice, 0.97) else 0.2,
        "mu": dice.choice((0.0, 0.1, 0.5)),
    }
    if seldom(dice, 0.1):
        found["rho"] = about(dice, 0.01)
    if seldom(dice, 0.2):
        found["sticking"] = "contact_point"
    return found


def motion(dice: Dice, length: float) -> dict[str, Any]:
    """Motion of a wall of a box of this length."""
    kind = dice.choice(("steady", "sine", "sine", "sawtooth"))
    found: dict[str, Any] = {"kind": kind, "direction": [either(dice, 1.0), dice.choice((1.0, -1.0))]}
    if kind == "steady":
        return found | {"speed": either(dice, 0.1)}
    return found | {"amplitude": about(dice, 0.01 * length), "frequency": about(dice, 1.0)}


def wall(dice: Dice, lengths: list[float], moves: bool) -> dict[str, Any]:
    """A wall in a box; of still ones, lines, segments and posts only."""
    width, height = lengths

    def place() -> list[float]:
        return [round(dice.uniform(0.0, 1.0) * each, 3) for each in lengths]

    shapes = ("line", "segment", "post", "container", "arc", "polyline", "polygon")
    shape = dice.choice(shapes if moves else shapes[:3])
    found: dict[str, Any] = {"shape": shape, "material": "w"}
    if shape == "line":
        found |= {"point": [0.0, round(dice.uniform(0.0, 0.3) * height, 3)], "normal": [0.0, 1.0]}
        if seldom(dice):
            found |= {"point": place(), "normal": [either(dice, 1.0), 1.0]}
    elif shape == "segment":
        found |= {"start": place(), "end": place()}
    elif shape in ("polyline", "polygon"):
        found["points"] = [place() for _ in range(dice.choice((3, 3, 4)))]
        if shape == "polygon" and seldom(dice):
            found["holds"] = dice.choice(("inside", "outside"))
    else:
        size = 0.48 * min(lengths) if shape != "post" else about(dice, 0.1 * min(lengths), 0.5)
        found |= {"center": place() if shape == "post" else [0.5 * width, 0.5 * height], "radius": size}
        if shape == "arc" and seldom(dice, 0.7):
            found["angles"] = [round(dice.uniform(-3.0, 0.0), 2), round(dice.uniform(0.1, 3.0), 2)]
    if seldom(dice, 0.2):
        found["surface_speed"] = either(dice, 1.0)
    if not moves:
        return found
    if seldom(dice, 0.4):
        found["motion"] = motion(dice, min(lengths))
    if seldom(dice) and shape != "line":
        turn = {"kind": "steady", "rate": either(dice, 1.0)}
        if seldom(dice):
            turn = {"kind": "sine", "amplitude": about(dice, 0.3), "frequency": about(dice, 1.0)}
        found["turn"] = turn | {"center": place()}
    if seldom(dice, 0.2):
        del found["material"]
        found["temperature"] = about(dice, 1.0)
    if seldom(dice, 0.2):
        found[dice.choice(("opens_at", "moves_from", "moves_until"))] = either(dice, 0.5)
    elif seldom(dice, 0.1):
        found["opens_after"] = dice.choice((0, 1, 100))
    return found


def piston(dice: Dice, lengths: list[float]) -> dict[str, Any]:
    """A piston above the disks, or a segment across the box."""
    width, height = lengths
    given: dict[str, Any] = {"mass": about(dice, 10.0)}
    for name, size in (("force", 1.0), ("velocity", 1.0), ("displacement", 0.01 * height)):
        if seldom(dice, 0.4):
            given[name] = either(dice, size)
    if seldom(dice):
        given["spring"] = about(dice, 1.0)
    if seldom(dice, 0.7):
        given |= {"low": -about(dice, 0.1 * height), "high": about(dice, 0.1 * height)}
    found: dict[str, Any] = {"material": "w", "piston": given}
    if seldom(dice):
        return found | {"shape": "segment", "start": [0.0, 0.8 * height], "end": [width, 0.8 * height]}
    return found | {"shape": "line", "point": [0.0, 0.9 * height], "normal": [0.0, -1.0]}


def force(dice: Dice, kind: str | None = None) -> dict[str, Any]:
    """A force."""
    kind = kind or dice.choice(
        ("random_kicks", "spin_kicks", "langevin", "drag", "rescale", "table_friction")
    )
    values: dict[str, dict[str, Any]] = {
        "random_kicks": {dice.choice(("power", "diffusion")): about(dice, 1.0)},
        "spin_kicks": {dice.choice(("power", "diffusion")): about(dice, 1.0)},
        "langevin": {"temperature": about(dice, 1.0), "rate": about(dice, 1.0)},
        "drag": {dice.choice(("rate", "quadratic", "spin_rate")): about(dice, 1.0)},
        "rescale": {dice.choice(("temperature", "energy")): about(dice, 1.0)},
        "table_friction": {"mu": about(dice, 0.2), "gravity": about(dice, 9.81)},
    }
    return {"kind": kind, "step": about(dice, 0.1)} | values[kind]


def output(dice: Dice, kind: str, n: int, lengths: list[float]) -> dict[str, Any]:
    """Output of a run."""
    found: dict[str, Any] = {"picture": False, "views": False}
    found[dice.choice(("frames", "frames", "frames_interval", "frames_collisions"))] = dice.choice((1, 2, 7))
    if seldom(dice):
        found[dice.choice(("series", "series_interval", "series_collisions"))] = dice.choice((1, 5))
    if kind in ("still", "moving") and seldom(dice, 0.5):
        found["wall_sums"] = True
    if kind == "histories":
        way = dice.choice(("histories", "histories_sample", "histories_region", "histories_all"))
        ways: dict[str, Any] = {
            "histories": [0, dice.choice((1, n))], "histories_sample": dice.choice((1, n, n + 1)),
            "histories_region": [0.0, 0.0, *(0.7 * each for each in lengths)], "histories_all": True,
        }  # fmt: skip
        found[way] = ways[way]
    return found


def start_file(dice: Dice, n: int, lengths: list[float], radius: float) -> str:
    """Rows of a CSV file: disks on a grid, some of which touch the sides, with velocities of some kind."""
    columns = max(int(lengths[0] / (2.2 * radius)), 1)
    speed = dice.choice((0.0, 1.0, 1.0, 1e-200, 1e12))
    alike = seldom(dice)
    common = [either(dice, 1.0), either(dice, 1.0)]
    rows = ["x,y,vx,vy,spin"]
    edge = dice.choice((radius, 1.1 * radius, radius * (1.0 - 1e-16)))
    for i in range(n):
        x, y = edge + 2.2 * radius * (i % columns), edge + 2.2 * radius * (i // columns)
        v = common if alike else [speed * dice.gauss(0.0, 1.0), speed * dice.gauss(0.0, 1.0)]
        rows.append(f"{x!r},{y!r},{v[0]!r},{v[1]!r},0")
    return "\n".join(rows) + "\n"


def random_case(dice: Dice, kind: str | None = None) -> tuple[dict[str, Any], str | None]:
    """A case of one of `KINDS`, and the start file "start.csv" that it may name."""
    kind = kind or dice.choice(KINDS)
    walled = kind in ("still", "moving", "pistons", "rest", "contact_time")
    run: dict[str, Any] = {"name": "case", "seed": dice.randrange(1000), "threads": 1, "units": "reduced"}
    run |= {"t_end": about(dice, 1.0)} if seldom(dice, 0.6) else {"collisions_per_disk": about(dice, 3.0)}
    if seldom(dice, 0.02):
        run["threads"] = 10**6
    if kind == "f32":
        run["precision"] = "f32"
    sizes = [dice.choice((1, 2, 10, 40)), *([dice.choice((1, 20))] if kind not in ("plain", "f32") else [])]
    radius = about(dice, 0.5, 0.1)
    species: list[dict[str, Any]] = []
    for i, number in enumerate(sizes):
        one: dict[str, Any] = {
            "name": f"s{i}",
            "number": number,
            "material": "ab"[i],
            "mass": about(dice, 1.0),
        }
        one["radius"] = float(f"{radius * dice.choice((0.6, 1.4)):.4g}") if i else radius
        one["speed_rms"] = dice.choice((0.0, about(dice, 1.0), about(dice, 1.0), about(dice, 1.0)))
        if seldom(dice):
            one["spin_rms"] = about(dice, 1.0)
        if seldom(dice, 0.2):
            one["k"] = dice.choice((1.0, 1.5, 2.5))
        species.append(one)
    if kind == "mixed" and seldom(dice):
        del species[0]["radius"]
        species[0]["radii"] = {"distribution": "lognormal", "mean": radius, "deviation": 0.2 * radius}
    n, largest = sum(sizes), radius * 1.4
    side = (n * 3.1416 * largest**2 / dice.choice((0.002, 0.1, 0.1, 0.3, 0.45))) ** 0.5
    side = float(f"{max(side, 6.1 * largest):.4g}")
    lengths = [side, float(f"{side * dice.choice((1.0, 1.0, 2.0)):.4g}")]
    box: dict[str, Any] = {"lengths": lengths}
    if not walled and seldom(dice, 0.6):
        box = {"packing_fraction": min(about(dice, 0.1, 0.5), 0.9)}
    if kind == "sheared":
        box["shear_rate"] = either(dice, 1.0)
    if kind == "open":
        box["open"] = True
    if kind in ("rest", "contact_time", "pistons") or (walled and seldom(dice, 0.6)):
        box |= {"periodic": [seldom(dice) and kind != "rest", False], "material": "w"}
    if "material" in box and (kind == "rest" or seldom(dice, 0.6)):
        box["gravity"] = [0.0, -about(dice, 1.0)]
        if not any(box["periodic"]) and seldom(dice, 0.2):
            box["gravity_rotation_rate"] = either(dice, 0.1)
    if kind == "rest":
        run |= {"collapse": "rest", "resting_speed": about(dice, 0.01)}
    elif kind == "contact_time":
        run |= {"collapse": "contact_time", "contact_time": about(dice, 0.01)}
    elif seldom(dice):
        run |= {"collapse": "velocity_cutoff", "velocity_cutoff": about(dice, 0.01)}
    names = ["a", "b"][: len(sizes)]
    case: dict[str, Any] = {"run": run, "box": box}
    case["material"] = [{"name": name} | law(dice) for name in names]
    pairs = [["a", "b"]] if len(names) > 1 else []
    case["pair"] = [
        {"materials": pair} | law(dice) for pair in (*pairs, *([name, "w"] for name in names if walled))
    ]
    case["species"] = species
    if walled:
        moves = kind == "moving"
        walls = [wall(dice, lengths, moves) for _ in range(dice.choice((0, 1, 1, 2)) if not moves else 2)]
        if kind == "pistons":
            walls = [piston(dice, lengths) for _ in range(dice.choice((1, 1, 2)))]
        if not walls and "material" not in box:
            walls = [wall(dice, lengths, moves)]
        case["wall"] = walls
        used = "material" in box or any("material" in each for each in walls)
        case["pair"] = [each for each in case["pair"] if used or "w" not in each["materials"]]
    if seldom(dice, 0.25) and kind != "rest":
        case["force"] = [force(dice) for _ in range(dice.choice((1, 1, 2)))]
    case["output"] = output(dice, kind, n, lengths)
    file = None
    way = dice.choice(("random", "random", "random", "grown", "hexagonal", "file"))
    if way == "file" and "radii" not in species[0]:
        file = start_file(dice, n, lengths, largest)
        case["start"] = {"file": "start.csv"}
        for one in species:
            one.pop("speed_rms"), one.pop("spin_rms", None)
        if kind == "open":
            case["box"] = {"open": True}
        elif "packing_fraction" in box:
            del box["packing_fraction"]
            box["lengths"] = lengths
    elif way != "file":
        case["start"] = {"positions": way}
    if walled and "material" not in box and seldom(dice, 0.3):  # drawn last: others stay
        box["shear_rate"] = either(dice, 1.0)
    return case, file


def disagreement(case: dict[str, Any], rows: str | None, folder: Path) -> tuple[str, str | None]:
    """Answer of `check`, "accepted", "refused" or "refused here", and what a run says otherwise, None if they agree.

    `rows` are those of the start file, if it has one.
    """
    path = folder / "case.toml"
    path.write_text(text_of(case), encoding="utf-8")
    if rows is not None:
        (folder / "start.csv").write_text(rows, encoding="utf-8")
    warned: Sequence[str] = ()
    try:
        with _silence():
            file = case_file.read(path)
            warned = reporting.check(file.gas, folder).warnings
    except InputError as error:
        return "refused", None if str(error).strip() else "check: no reason"
    except Exception as error:  # the error that is searched for, with its type
        return "refused", f"check: {type(error).__name__}: {error}"
    here = any(REFUSED_HERE in each for each in warned)
    ends = ENDS[case["run"].get("collapse", "none") != "none" :]  # a remedy prevents the first one
    try:
        with _silence(), contextlib.suppress(Stopped):
            outputs = Outputs.plan(file.case, f"{folder}/", picture=False)
            running.run(file, outputs, force=True, max_hours=1e-9, log=_ignore, warn=_ignore)
    except InputError as error:
        return ("refused here", None) if here else ("accepted", f"run: {error}")
    except Exception as error:
        if not (isinstance(error, EngineError) and any(each in str(error) for each in ends)):
            return "accepted", f"run: {type(error).__name__}: {error}"
    return "accepted", "run: does what check warns of" if here else _on_ranks(file)


def _ignore(_text: str) -> None:
    """Discard the output of a run."""


@contextlib.contextmanager
def _silence() -> Iterator[None]:
    """Suppress progress output and warnings."""
    with contextlib.redirect_stderr(io.StringIO()), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def _on_ranks(file: CaseFile) -> str | None:
    """Text on a disagreement between the rules of cases and of the engine on two ranks; None if they agree."""
    gas = file.gas
    case = gas.case
    count, why = gas.usable_ranks(2)
    if count == 1 and "cannot be divided" not in why:  # too few tiles, which the engine finds later
        return None
    try:
        checks.check_exclusions(gas.setup, n=gas.n, immovable=False, histories=case.output.tracks, ranks=2)
    except InputError as error:
        return None if why else f"on ranks: {error}"
    return f"on ranks: {why}" if why else None


def cases(first: int, last: int, seed: int) -> Iterator[tuple[int, dict[str, Any], str | None]]:
    """Cases `first` to `last` of a seed, each of which has dice of its own."""
    for number in range(first, last):
        yield number, *random_case(Dice(f"{seed} {number}"))


def run(quick: bool, seed: int = 1) -> Result:
    """Compare both commands for many cases."""
    result, counts, faults = Result(), Counter[str](), list[str]()
    with tempfile.TemporaryDirectory() as folder:
        for number, case, file in cases(0, QUICK if quick else COUNT, seed):
            status, fault = disagreement(case, file, Path(folder))
            counts[status] += 1
            if fault is not None:
                faults.append(f"case {number}: {fault}")
    total = sum(counts.values())
    text = f"random cases of {total} on which check and run disagree"
    result.near(text, len(faults), 0.0, 0.0, "none may be", "; ".join(faults[:3]) or REFERENCE)
    part = counts["accepted"] / total
    result.at_least("part of them accepted", part, 0.4, "with fewer the cases say little", "the generator")
    result.table("Answers of check", ("answer", "cases"), [*counts.items()])
    return result


if __name__ == "__main__":
    begin, end, chosen = map(int, sys.argv[1:4])
    tally = Counter[str]()
    with tempfile.TemporaryDirectory() as place:
        for which, drawn, rows in cases(begin, end, chosen):
            answer, problem = disagreement(drawn, rows, Path(place))
            tally[answer] += 1
            if which % 100 == 99:
                print(which + 1, dict(tally), flush=True)
            if problem is not None:
                print(which, problem, flush=True)
    print(dict(tally))
