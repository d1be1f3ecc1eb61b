"""Attacks on files that are read and folders that are written: `python -m support.attacks`, in tests/.

`... attacks [NAME ...] [--cases N] [--seed S]` runs N cases of each attack, or of those that are named, drawn by
Hypothesis from a seed, and prints the smallest case that did not end in an answer or a message: a traceback, a hang, a
crash of the process, a result that is silently another one. An attack draws what it does to files and does it; what it
returns, the program's answer, runs in a forked process, because HDF5 can end it: POSIX only.
`tests/trajectory/test_attacks.py` has a sample.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

import h5py
import hypothesis
import numpy as np
from cyclopts import Parameter
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.cases import case_text
from support.drawn import Dice, damaged, damages

import ifrdem
from ifrdem.cli import main as cli
from ifrdem.errors import InputError
from ifrdem.laws import IFRLaw
from ifrdem.model.laws.records import to_record
from ifrdem.model.state import State
from ifrdem.quantities import MECHANISMS, PISTON_SERIES
from ifrdem.study import figure, task
from ifrdem.study.results import Results
from ifrdem.study.task import Variable
from ifrdem.tools import arguments
from ifrdem.trajectory.views import write_views

Act = Callable[[], None]
PATIENCE = 60
"""Seconds that a case may take."""
NONSENSE: tuple[Any, ...] = (
    None, True, -1, 0, 3.5, 1e300, 10**400, float("nan"), float("inf"), "", "x", "\x1b[2J", "\ud800", [], [[]], {},
    [1e999],
)  # fmt: skip
STUDY = case_text({
    "run.seed": 3, "run.collisions_per_disk": 20.0, "run.threads": 1, "run.t_end": None, "run.units": None,
    "species[0].number": 60, "species[0].diameter": 1.0, "species[0].speed_rms": 1.4,
    "species[0].radius": None, "output": {"frames": 4, "series": 5},
})  # fmt: skip


def alone(act: Callable[[], object], seconds: int = PATIENCE) -> str:
    """Outcome of an act in a process of its own: "" if it ends, by an InputError too; else what went wrong."""
    reading_end, writing_end = os.pipe()
    process = os.fork()
    if not process:
        failure = ""
        try:
            os.close(reading_end)
            nowhere = os.open(os.devnull, os.O_RDWR)
            for stream in (0, 1, 2):
                os.dup2(nowhere, stream)
            sys.stdout = sys.stderr = open(os.devnull, "w")  # noqa: SIM115 (as long as the process)
            signal.signal(
                signal.SIGALRM, signal.SIG_DFL
            )  # which also ends a call of HDF5 that does not return
            signal.alarm(seconds)
            with warnings.catch_warnings(action="ignore"):
                act()
        except InputError:
            pass
        except BaseException:
            failure = traceback.format_exc()
        os.write(writing_end, failure.encode(errors="replace")[-4000:])
        os._exit(0)
    os.close(writing_end)
    with open(reading_end, "rb") as reader:
        text = reader.read().decode(errors="replace")
    status = os.waitpid(process, 0)[1]
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        return (
            f"no end in {seconds} s"
            if number == signal.SIGALRM
            else f"ended by {signal.Signals(number).name}"
        )
    return text


def says(words: list[str], allowed: tuple[int, ...] = (0, 2)) -> str:
    """Output of a command line; AssertionError unless it ends in one of the exit statuses without a traceback."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = cli.main(words)
    shown = out.getvalue() + err.getvalue()
    if status not in allowed or "Traceback" in shown or (status == 2 and "ifrdem: " not in err.getvalue()):
        raise AssertionError(f"{words}: exit status {status}: {shown}")
    return shown


def altered(value: Any, chance: Dice) -> Any:
    """A value of JSON with one of its parts replaced by nonsense, or left out."""
    if isinstance(value, dict | list) and value and chance.random() < 0.9:
        copy: Any = value.copy()
        key = chance.choice(list(value)) if isinstance(value, dict) else chance.randrange(len(value))
        if chance.random() < 0.1:
            del copy[key]
        else:
            copy[key] = altered(value[key], chance)
        return copy
    return chance.choice(NONSENSE)


def harm(path: Path, chance: Dice) -> str:
    """Replace a dataset or an attribute of an HDF5 file by nonsense; returns which."""
    with h5py.File(path, "r+") as file:
        places: list[tuple[str, str | None]] = []
        file.visititems(
            lambda name, item: places.extend([(name, None), *((name, key) for key in item.attrs)])
        )
        name, key = chance.choice(places)
        old = file[name].attrs[key] if key is not None else file[name]
        text = (
            old if key is not None else old[()] if isinstance(old, h5py.Dataset) and old.shape == () else None
        )
        if isinstance(text, bytes) and text[:1] in b"[{" and chance.random() < 0.8:
            new: Any = json.dumps(altered(json.loads(text), chance))
        else:
            shape, dtype = getattr(old, "shape", ()), getattr(old, "dtype", np.dtype("f8"))
            dtype = dtype if dtype.kind in "iuf" else np.dtype("f8")
            whole = np.ones(shape, dtype) if np.prod(shape, dtype=float) < 1e6 else np.ones(3)
            new = chance.choice(
                (
                    3.0,
                    -1,
                    "x",
                    "[" * 1000,
                    np.nan * np.ones(shape),
                    np.inf * np.ones(shape),
                    -whole.astype("f8"),
                    0 * whole,
                    1e300 * np.ones(shape),
                    whole[..., None],
                    whole.ravel()[:-1],
                    np.zeros(0, dtype),
                    h5py.Empty("f8"),
                    np.array([b"a"] * 3),
                    np.zeros(shape, [("a", "f8"), ("b", "i4")]),
                    (2**31 - 1) * np.ones(shape, "i8"),
                    "without end",
                    "group",
                    "link",
                    "gone",
                )
            )
        if key is not None:
            with contextlib.suppress(OSError, RuntimeError, ValueError, TypeError):
                file[name].attrs[key] = new
        else:
            del file[name]
            if isinstance(new, str) and new == "without end":
                file.create_dataset(name, shape=(10**12,), dtype="f8", chunks=(1024,))
            elif isinstance(new, str) and new == "group":
                file.create_group(name)
            elif isinstance(new, str) and new == "link":
                file[name] = h5py.SoftLink(f"/{name}")
            elif not (isinstance(new, str) and new == "gone"):
                file[name] = new
    return f"{name} {key or ''}: {str(new)[:60]}"


# --- what is attacked


def heap(path: Path) -> None:
    """A trajectory of disks under a piston, with a post and a vibrating wall, and all that a file can hold."""
    n, frames = 12, 8
    wall = ifrdem.Wall
    walls = [
        wall.line((0.0, 1.0), (0.0, 1.0)),
        wall.line((0.0, 8.0), (0.0, -1.0), piston=ifrdem.Piston(mass=2.0)),
        wall.post((7.0, 4.0), 0.5),
        wall.segment((1.0, 3.0), (3.0, 3.0), motion=ifrdem.Motion(kind="sine", amplitude=0.1, frequency=1.0)),
    ]
    chance = np.random.default_rng(1)
    disks = ifrdem.Disks(n, 1.0, 0.2)
    box = ifrdem.Box((9.0, 9.0), (True, False))
    fields = ("position", "velocity", "angle", "angular_velocity", "collisions", "image", "dissipated")
    record = {
        "name": "heap", "case": STUDY, "gravity": "[0.0, -1.0]", "materials": '["coin"]', "forces": "[]",
        "species": json.dumps([{"name": "coins", "number": n, "material": "coin"}]),
        "laws": json.dumps([[to_record(IFRLaw(e_n=0.9, e_t=-0.9, mu=0.1))]]),
    }  # fmt: skip
    names = ["wall 0 line", "wall 1 line", "wall 2 post", "wall 3 segment"]
    start = None
    with ifrdem.TrajectoryWriter(
        path, disks, box, fields=fields, walls=walls, parameters=record, units={"length": "m", "time": "s"}
    ) as writer:
        for number in range(frames):
            state = State(
                chance.uniform(1.2, 7.8, (n, 2)), chance.normal(size=(n, 2)), chance.normal(size=n), time=0.1 * number,
                angle=chance.normal(size=n), collisions=np.full(n, number, np.int32), image=np.zeros((n, 2), np.int32),
                dissipated=np.zeros((n, 7)),
            )  # fmt: skip
            whole: dict[str, Any] = {
                "collisions": 6 * number, "temperature": 1.0, "rotational_temperature": 0.5, "energy": 2.0,
                "translational_energy": 1.0, "rotational_energy": 1.0, "potential_energy": 0.0,
                "dissipated_energy": 0.0,
                "energy_input": 0.0, "wall_work": 0.0, "wall_heat": 0.0, "ledger_residual": 0.0,
                "dissipated_by_mechanism": np.full(7, 0.1 * number), "collisions_by_regime": np.full(5, number),
                **{name: np.array([0.1 * number]) for name in PISTON_SERIES},
            }  # fmt: skip
            if start is None:
                start = state
                writer.begin_histories([2, 5], state)
            writer.write(state, whole)
            sums = {
                f"walls_{name}": np.full(4, 0.1 * number)
                for name in ("momentum_x", "momentum_y", "torque", "work", "heat")
            }
            row = {**whole, **sums, "walls_hits": np.full(4, number)}
            columns = {name: names for name in row if name.startswith("walls_")}
            columns["dissipated_by_mechanism"] = list(MECHANISMS)
            columns |= {name: ["wall 1 line"] for name in row if name.startswith("piston_")}
            writer.write_series(0.1 * number, row, columns)


def some_results(path: Path) -> None:
    """Results of a study over a coefficient and a number, with seeds and rows."""
    chance = np.random.default_rng(1)
    rows, dims = "collisions_per_disk", ("e_n", "number")
    found: dict[str, Variable] = {
        "e_n": Variable(("e_n",), np.array([0.7, 0.9])), "number": Variable(("number",), np.array([20, 40])),
        "kind": Variable(("e_n",), np.array(["soft", "hard"])), "seed": Variable(("seed",), np.array([1, 2, 3])),
        rows: Variable((rows,), np.linspace(0.0, 4.0, 6)),
        "mechanism": Variable(("mechanism",), np.array(["normal", "sliding"])),
    }  # fmt: skip
    for name in ("temperature", "time", "theta"):
        found[name] = Variable((*dims, "seed", rows), chance.uniform(0.1, 1.0, (2, 2, 3, 6)), "J")
        for kind in ("mean", "error", "theory"):
            found[f"{name}_{kind}"] = Variable((*dims, rows), chance.uniform(0.1, 1.0, (2, 2, 6)), "J")
    found["dissipated_by_mechanism"] = Variable(
        (*dims, "seed", rows, "mechanism"), chance.uniform(size=(2, 2, 3, 6, 2))
    )
    for name in ("run", "failure"):
        found[name] = Variable((*dims, "seed"), np.full((2, 2, 3), name, dtype=object))
    axes, keys = (
        {"e_n": ["e_n", "kind"], "number": ["number"]},
        {"e_n": "material[0].e_n", "kind": "k", "number": "species[0].number"},
    )
    Results(
        found, {"axes": json.dumps(axes), "keys": json.dumps(keys), "title": "some", "case": STUDY}
    ).write(path)


# --- attacks: each takes a folder of its own, what was made once, and chance; it returns what runs in a process of its own


def harmed(path: Path, content: bytes, chance: Dice) -> str:
    """Write a file with damaged bytes or nonsense in it; returns which."""
    damage = chance.draw(st.none() | damages(content))
    path.write_bytes(damaged(content, damage or ()))
    return str(damage) if damage else harm(path, chance)


def result_of_a_run(folder: Path, made: Mapping[str, bytes], chance: Dice) -> Act:
    """Damaged NAME.runs/*.npz: refused, or the same to the last bit."""
    path = folder / "a.npz"
    path.write_bytes(made["result"])
    whole = task.load(path)
    path.write_bytes(damaged(made["result"], chance.draw(damages(made["result"]))))

    def act() -> None:
        found, seconds = task.load(path)
        same = found.keys() == whole[0].keys() and seconds == whole[1]
        for name, (dims, values, unit, text) in whole[0].items():
            other = found[name]
            if not (
                same
                and (other.dims, other.unit, other.text) == (dims, unit, text)
                and np.array_equal(other.values, values, equal_nan=True)
            ):
                raise AssertionError(f"another {name}")

    return act


def results(folder: Path, made: Mapping[str, bytes], chance: Dice) -> Act:
    """Damaged NAME.nc, and one with nonsense in it: pictures and the viewer's points fail, and no reader crashes."""
    path = folder / "some.nc"
    harmed(path, made["results"], chance)
    what = chance.choice(("T", "theta", "time", "dissipated_by_mechanism"))
    over, point = chance.choice((None, "tau", "t", "e_n", "number")), chance.randrange(4)

    def act() -> None:
        from ifrdem.viewer.points import StudyPoints

        found = Results.read(path)
        for each in (
            lambda: figure.draw(found, what, over),
            lambda: StudyPoints(path).head(),
            lambda: StudyPoints(path).point(point),
            found.to_xarray,
        ):
            with contextlib.suppress(InputError):
                each()

    return act


def concat(folder: Path, made: Mapping[str, bytes], chance: Dice) -> Act:
    """`concat` of whole and damaged trajectories: a message that names one of them, or a data set."""
    paths = [folder / f"{i}.h5" for i in range(3)]
    for path in paths:
        path.write_bytes(made["heap"])
    for path in chance.sample(paths, chance.choice((1, 2))):
        harmed(path, made["heap"], chance)
    order = chance.sample(paths, 3)

    def act() -> None:
        try:
            ifrdem.concat(order).load()
        except InputError as error:
            if not any(str(path) in str(error) for path in paths):
                raise AssertionError(f"{error}: names none of the files") from error

    return act


PICTURES = (
    "disks",
    "walls",
    "piston",
    "energy",
    "ledger",
    "temperatures",
    "mechanisms",
    "velocity",
    "msd",
    "dissipation",
    "fields",
)


def verbs(f: str, folder: Path) -> list[list[str]]:
    """Command lines that read a trajectory."""
    return [
        ["info", f], *(["plot", f, each, "-o", str(folder / f"{each}.png")] for each in PICTURES),
        ["history", f, "--id", "2"], ["link", f], ["view", f, "--html", f"{folder}/page.html"],
        *(["export", f, "--to", each, "-o", f"{folder}/o.{each}"] for each in ("csv", "extxyz", "gsd")),
        ["export", f, "--to", "h5", "-o", f"{folder}/copy.h5"], ["repair", f, "-o", f"{folder}/repaired.h5"],
        ["movie", f, "--frames", "0", "-o", f"{folder}/m.gif", "--size", "160x160"],
        ["analyse", f, "velocity", "msd", "-o", f"{folder}/analysis"],
    ]  # fmt: skip


def heaps(folder: Path, made: Mapping[str, bytes], chance: Dice) -> Act:
    """Nonsense in a trajectory with a heap and a piston: every verb ends in an answer or a message."""
    path = folder / "heap.h5"
    path.write_bytes(made["heap"])
    what, lines = harm(path, chance), chance.sample(verbs(str(path), folder), 4)

    def act() -> None:
        for words in lines:
            try:
                says(words)
            except Exception as error:  # raised again, with the damage and the command that led to it
                raise AssertionError(f"{what}: {words}") from error

    return act


def studies(folder: Path, made: Mapping[str, bytes], chance: Dice) -> Act:
    """A study that is killed, and whose files are damaged, ends with the results of an undisturbed one."""
    (folder / "gas.toml").write_text(STUDY)
    (folder / "s.toml").write_text(
        'case = "gas.toml"\n[sweep]\n"material[0].e_n" = [0.7, 0.9]\n[ensemble]\nseeds = 2\n'
        f"[output]\nseries = 5\ntrajectories = {'true' if chance.random() < 0.5 else 'false'}\n"
    )
    words = ["study", str(folder / "s.toml"), "--workers", "0", "-o", str(folder / "s.nc")]
    numbers = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
    kills = [(chance.uniform(0.5, 3.0), chance.choice(numbers)) for _ in range(chance.choice((1, 2)))]
    # Which files are there when the process is killed is not known before: a part of what there is then.
    cuts = [(chance.random(), chance.random()) for _ in range(chance.choice((0, 1, 2)))]

    def act() -> None:
        for seconds, number in kills:
            process = os.fork()
            if not process:
                with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
                    cli.main(words)
                os._exit(0)
            time.sleep(seconds)
            os.kill(process, number)
            os.waitpid(process, 0)
            there = [each for each in (folder / "s.runs").glob("*") if each.suffix in (".npz", ".h5")]
            for which, part in cuts if there else ():
                each = there[int(which * len(there))]
                content = each.read_bytes()
                each.write_bytes(content[: int(part * len(content))])
        shown = says(words, (0,))
        done, whole = Results.read(folder / "s.nc"), made["study"]
        for name in ("temperature", "dissipated_by_mechanism"):
            if done.values(name).tobytes() != np.load(io.BytesIO(whole))[name].tobytes():
                raise AssertionError(f"another {name}: {shown}")

    return act


@contextlib.contextmanager
def read_only(folder: Path, content: Mapping[str, bytes]) -> Iterator[None]:
    """A folder whose files cannot be written, not even by root."""
    folder.mkdir()
    mounted = os.geteuid() == 0
    if mounted:
        subprocess.run(["mount", "-t", "tmpfs", "-o", "size=8m", "tmpfs", str(folder)], check=True)
    try:
        for name, data in content.items():
            (folder / name).write_bytes(data)
        if mounted:
            subprocess.run(["mount", "-o", "remount,ro", str(folder)], check=True)
        else:
            folder.chmod(0o555)
        yield
    finally:
        if mounted:
            subprocess.run(["umount", "-l", str(folder)], check=True)
        else:
            folder.chmod(0o755)


def can_be_read_only() -> bool:
    """True if a folder can be made that this user cannot write to."""
    if os.geteuid():
        return True
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(["mount", "-t", "tmpfs", "tmpfs", folder], capture_output=True, check=False)
        return done.returncode == 0 and subprocess.run(["umount", folder], check=False).returncode == 0


def read_only_folders(folder: Path, made: Mapping[str, bytes], chance: Dice) -> Act:
    """Verbs that write into a folder that cannot be written to name it; those that only read work."""
    place = folder / "fixed"
    content = {"heap.h5": made["heap"], "gas.toml": STUDY.encode(), "some.nc": made["results"]}
    f, case = str(place / "heap.h5"), str(place / "gas.toml")
    writing = [
        ["run", case, "-o", f"{place}/"], ["run", case, "-o", f"{place}/heap", "--force"], ["link", f],
        ["repair", f, "--in-place"], ["study", case, "--seeds", "2", "-o", f"{place}/s.nc"],
        ["study", case, "-o", f"{place}/some.nc"],
        *(["export", f, "--to", each] for each in ("csv", "extxyz", "gsd")), ["movie", f, "-o", f"{place}/m.webp"],
        *(["plot", f, each, "-o", f"{place}/{each}.png"] for each in ("disks", "walls")),
        ["view", f, "--html", f"{place}/p.html"],
        ["plot", f"{place}/some.nc", "T", "-o", f"{place}/T.png"], ["analyse", f, "velocity", "-o", f"{place}/a"],
        ["new", "cooling", "-o", f"{place}/c.toml"], ["new", "cooling", "-o", case, "--force"],
        ["history", f, "--id", "2", "-o", f"{place}/h.csv"],
        ["run", case, "-o", "/proc/x"], ["study", case, "-o", "/sys/kernel/s.nc"],
        ["export", f, "--to", "csv", "-o", "/proc/1/o.csv"],
    ]  # fmt: skip
    words = chance.choice(writing)

    def act() -> None:
        with read_only(place, content):
            before = sorted(place.iterdir())
            shown = says(words, (0, 2) if words[0] == "repair" else (2,))  # there may be nothing to repair
            if not any(str(each) in shown for each in (place, "/proc", "/sys")):
                raise AssertionError(f"{words}: {shown}")
            if sorted(place.iterdir()) != before:
                raise AssertionError(f"{words}: left something")
            for reading in (["info", f], ["plot", f, "disks", "-o", str(folder / "d.png")], ["check", case]):
                says(reading, (0,))
            for write in (
                lambda: ifrdem.TrajectoryWriter(
                    f, ifrdem.Disks(1, 1.0, 0.1), ifrdem.Box((1.0, 1.0)), force=True
                ),
                lambda: write_views(f),
                lambda: some_results(place / "r.nc"),
            ):
                try:
                    write()
                except InputError as error:
                    if str(place) not in str(error):
                        raise AssertionError(str(error)) from error
                else:
                    raise AssertionError("a folder that cannot be written to was")

    return act


Attack = Callable[[Path, Mapping[str, bytes], Dice], Act]
ATTACKS: dict[str, Attack] = {
    one.__name__: one for one in (result_of_a_run, results, concat, heaps, studies, read_only_folders)
}
CASES = {
    "result_of_a_run": 3000,
    "results": 150,
    "concat": 400,
    "heaps": 200,
    "studies": 12,
    "read_only_folders": 40,
}
"""Cases that take a minute on one core."""


def made_once(folder: Path, names: tuple[str, ...]) -> dict[str, bytes]:
    """The whole files that attacks begin with."""
    heap(folder / "heap.h5")
    some_results(folder / "some.nc")
    result = {
        "temperature": Variable(("tau",), np.linspace(1.0, 0.1, 30), "J"),
        "runs": Variable((), np.array(3.0)),
    }
    task.save(folder / "result.npz", result | {"x": Variable(("tau", "axis"), np.ones((30, 2)))}, seconds=1.5)
    if (
        names
    ):  # verbs read the whole files, and what they import is there for the many processes that are forked
        for words in (
            *verbs(str(folder / "heap.h5"), folder),
            ["plot", str(folder / "some.nc"), "T", "-o", f"{folder}/T.png"],
        ):
            says(words, (0,))
        ifrdem.concat([folder / "heap.h5"] * 2).load()
        Results.read(folder / "some.nc").to_xarray()
    made = {"heap": "heap.h5", "results": "some.nc", "result": "result.npz"}
    found = {name: (folder / file).read_bytes() for name, file in made.items()}
    if "studies" in names:  # in a process of its own, so that Taichi does not start here

        def whole() -> None:
            (folder / "gas.toml").write_text(STUDY)
            study = ifrdem.Study(
                folder / "gas.toml",
                vary=["material[0].e_n=0.7,0.9"],
                seeds=2,
                set=["output.series=5"],
                output=folder / "s",
            )
            study.run(workers=0)
            done = study.results()
            np.savez(
                folder / "study.npz",
                **{name: done.values(name) for name in ("temperature", "dissipated_by_mechanism")},
            )

        if failure := alone(whole, 600):
            raise RuntimeError(failure)
        found["study"] = (folder / "study.npz").read_bytes()
    return found


def attack(name: str, made: Mapping[str, bytes], data: st.DataObject) -> None:
    """Let Hypothesis draw a case of an attack; AssertionError with what went wrong."""
    with tempfile.TemporaryDirectory() as folder:
        failure = alone(ATTACKS[name](Path(folder), made, Dice(data.draw)))
    assert not failure, failure


def attacks(
    *names: Annotated[str, Parameter(name="NAME", help=f"attacks: {', '.join(ATTACKS)} (default: all)")],
    cases: int | None = None,
    seed: int = 1,
) -> int:
    """Run attacks at random, and print what went wrong."""
    for name in names:
        if name not in ATTACKS:
            raise InputError(f"NAME = {name}: must be one of {', '.join(ATTACKS)}")
    chosen = names or tuple(ATTACKS)
    with tempfile.TemporaryDirectory() as folder:
        made = made_once(Path(folder), chosen)
    count = 0
    for name in chosen:
        began = time.perf_counter()
        number = cases or CASES[name]

        @hypothesis.seed(seed)
        @settings(max_examples=number, deadline=None, database=None, suppress_health_check=list(HealthCheck))
        @given(st.data())
        def whole(data: st.DataObject) -> None:
            attack(name, made, data)  # noqa: B023 (called at once)

        try:
            whole()
        except AssertionError as error:
            print(f"{name}: {error}", *getattr(error, "__notes__", ()), sep="\n", flush=True)
            count += 1
        print(f"{name}: at most {number} cases, {time.perf_counter() - began:.0f} s", flush=True)
    return 1 if count else 0


if __name__ == "__main__":
    sys.exit(arguments.script(attacks))
