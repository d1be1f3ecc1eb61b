"""The command `ifrdem`. Imports what a verb needs when it is called: `--help` starts nothing."""

from __future__ import annotations

import argparse
import json
import math
import os
import shlex
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path

from ..errors import EngineError, InputError, nearest, printable
from ..run.outputs import trajectory_in
from ..tools.arguments import Parser, whole
from ..tools.versions import __version__
from . import (
    analyse,
    export,
    history_options,
    movie_options,
    plot_options,
    repair_options,
    tail_options,
    views_options,
)
from . import fit as fit_options

BAD_INPUT = 2
FAILED = 1
INTERRUPTED = 130  # what shells use for SIGINT
UNFINISHED = 3


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status.

    0, 1 (failed), 2 (bad input), 3 (stopped by --maxh or SIGUSR1, SIGUSR2), 130 (interrupted), 143 (terminated).
    """
    given = sys.argv[1:] if arguments is None else list(arguments)
    if sys.stdout is None:  # closed by the caller, as by `>&-`
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115 (as long as the process)
    try:
        options = _parse(given)
        if getattr(options, "file", None) and os.path.isdir(options.file):
            options.file = os.fspath(trajectory_in(Path(options.file)))
        with warnings.catch_warnings():
            warnings.showwarning = lambda message, *_args, **_options: _warn(str(message))
            status = int(options.act(options))
        sys.stdout.flush()  # here, where a broken pipe is caught
        return status
    except InputError as error:
        _complain(str(error))
        return BAD_INPUT
    except EngineError as error:
        _complain(f"the engine stopped: {error}")
        return FAILED
    except KeyboardInterrupt as error:
        _complain(str(error) or "interrupted")
        return INTERRUPTED
    except BrokenPipeError:  # the reader of our output went away, as `head` does
        _forget_output()
        return FAILED
    except OSError as error:  # such as a full disk; files have their own messages
        _forget_output()
        _complain(f"{error.strerror or error}{f': {error.filename}' if error.filename else ''}")
        return FAILED


def _forget_output() -> None:
    """Nothing that is left to write can be written: Python must not try again at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _complain(message: str) -> None:
    sys.stdout.flush()
    for line in message.splitlines():  # messages quote files, which may hold anything
        print(f"ifrdem: {printable(line)}", file=sys.stderr)


def _warn(message: str) -> None:
    _complain(f"warning: {message}")


def _say(message: str) -> None:
    print(message, flush=True)


def _parse(arguments: list[str]) -> argparse.Namespace:
    parser = Parser(
        prog="ifrdem",
        description="Event-exact simulation of granular gases of rough disks that collide by the independent "
        "friction-restitution law.",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"ifrdem {__version__}")
    verbs = parser.add_subparsers(title="verbs", metavar="VERB")

    run = verbs.add_parser(
        "run",
        help="run a case",
        description="Run a case file: writes NAME.h5 and NAME.png.",
        allow_abbrev=False,
    )
    _add_case(run)
    run.add_argument(
        "--arch", metavar="ARCH", help="device: cpu or cuda (see `ifrdem backends`); sets run.arch"
    )
    run.add_argument("--seed", metavar="N", help="seed of the random numbers; sets run.seed")
    run.add_argument("--threads", metavar="N", help="CPU threads; sets run.threads")
    run.add_argument("--precision", metavar="P", help="f64 or f32; sets run.precision")
    run.add_argument(
        "-o",
        "--output",
        metavar="PLACE",
        help="folder for NAME.h5 and NAME.png, or the files' path without its ending (default: this folder)",
    )
    run.add_argument("--force", action="store_true", help="replace output files that exist")
    run.add_argument("--no-picture", action="store_true", help="draw no picture at the end")
    _add_max_hours(run)
    run.set_defaults(act=_run)

    resume = verbs.add_parser(
        "resume",
        help="go on with a run that was stopped",
        description="Go on with a run that was interrupted, terminated, killed or out of time, from its checkpoint: "
        "the trajectory becomes bitwise that of a run that was never stopped.",
        allow_abbrev=False,
    )
    resume.add_argument(
        "place", metavar="PLACE", help="the trajectory (NAME.h5), or the folder that it is in"
    )
    resume.add_argument("--threads", metavar="N", help="CPU threads; the result does not depend on it")
    resume.add_argument(
        "--as-begun", action="store_true", help="go on with the case as it was, though its file has changed"
    )
    resume.add_argument("--no-picture", action="store_true", help="draw no picture at the end")
    _add_max_hours(resume)
    resume.set_defaults(act=_resume)

    tail = verbs.add_parser("tail", help="follow a run from another terminal", allow_abbrev=False)
    tail_options.add_to(tail)
    tail.set_defaults(act=_tail)

    check = verbs.add_parser(
        "check",
        help="look at a case without running it",
        description="Report the mistakes of a case, all of a kind at once; of a good one its packing fraction, mean "
        "free paths, whether its laws can add energy, its file size and memory.",
        allow_abbrev=False,
    )
    _add_case(check)
    check.set_defaults(act=_check)

    bench = verbs.add_parser(
        "bench",
        help="measure how fast it runs here",
        description="Time warm kernels: an elastic gas at equilibrium, a case (--case), or a grid of gases "
        "(--table). Prints the median of several runs and their range; progress goes to the standard error "
        "stream.",
        allow_abbrev=False,
    )
    _add_bench(bench)
    bench.set_defaults(act=_bench)

    validate = verbs.add_parser(
        "validate",
        help="reproduce the paper through the kernels",
        description="Collide disks as the paper does, and compare with its equations, tables and figures; `validate "
        "bullet` compares with PyBullet and pymunk instead, `validate gas` holds gases of many disks against the "
        "literature. Writes results.json, report.html and the figures. Exit status 0 only if every row passed.",
        allow_abbrev=False,
    )
    validate.add_argument(
        "names",
        metavar="NAME",
        nargs="*",
        help="cases or groups to run: paper (default), bullet, gas, or see --list",
    )
    validate.add_argument(
        "--quick", action="store_true", help="fewer samples: under a minute (gas: two minutes)"
    )
    validate.add_argument("--seed", type=int, metavar="N", help="of the random gases of gas (default: 1)")
    validate.add_argument(
        "--jobs",
        metavar="N",
        help="cases at a time, each in a process of its own (default: gas as many as there are cores, others 1)",
    )
    validate.add_argument("--list", action="store_true", help="list the cases and run none")
    validate.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        default="validation-report",
        help="folder (default: validation-report)",
    )
    validate.add_argument("--force", action="store_true", help="replace a report that is there")
    validate.set_defaults(act=_validate)
    fit = verbs.add_parser("fit", help="fit the law's coefficients to measured impacts", allow_abbrev=False)
    fit_options.add_to(fit)
    fit.set_defaults(act=_fit)

    analyse.add_to(verbs)
    plot_options.add_to(verbs)

    info = verbs.add_parser("info", help="say what a trajectory holds", allow_abbrev=False)
    info.add_argument("file", metavar="FILE", help="a trajectory (.h5)")
    info.set_defaults(act=_info)
    history_options.add_to(verbs)
    views_options.add_to(verbs)
    export.add_to(verbs)
    movie_options.add_to(verbs)
    repair_options.add_to(verbs)

    new = verbs.add_parser(
        "new",
        help="write a commented case file to start from",
        description="Write a commented case file to start from: a template with every key there is, or a "
        "shipped case (cases/NAME.toml, see `ifrdem cases`).",
        allow_abbrev=False,
    )
    new.add_argument(
        "kind",
        metavar="KIND",
        help="cooling (one kind of coins), driven (random kicks), mixture (two), walls (a shaken floor), or "
        "cases/NAME.toml",
    )
    new.add_argument("-o", "--output", metavar="FILE", help="file to write (default: KIND.toml; - prints it)")
    new.add_argument("--force", action="store_true", help="replace a file that exists")
    new.set_defaults(act=_new)

    cases = verbs.add_parser("cases", help="list the shipped cases", allow_abbrev=False)
    cases.set_defaults(act=_cases)

    docs = verbs.add_parser("docs", help="read the manual", allow_abbrev=False)
    docs.add_argument("topic", metavar="TOPIC", nargs="?", help="page to print (default: the list of pages)")
    docs.set_defaults(act=_docs)

    backends = verbs.add_parser("backends", help="list the devices that can compute", allow_abbrev=False)
    backends.set_defaults(act=_backends)

    known = list(verbs.choices)
    # The options before a verb take no values: the first other word is the verb.
    verb = next((word for word in arguments if not word.startswith("-")), None)
    if verb is not None and verb not in known:
        raise InputError(f"no verb is called '{verb}'{nearest(verb, known)}; there are: {', '.join(known)}")
    options, unknown = parser.parse_known_args(arguments)
    if unknown:
        own = verbs.choices[verb] if verb is not None else parser
        allowed = [name for action in own._actions for name in action.option_strings]
        close = nearest(unknown[0].split("=")[0], allowed) if unknown[0].startswith("-") else ""
        own.error(f"unrecognized arguments: {' '.join(unknown)}{close}")
    if not hasattr(options, "act"):
        parser.error(f"a verb is needed: {', '.join(known)}")
    return options


def _add_max_hours(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--maxh",
        metavar="HOURS",
        help=f"stop after so many hours, with a checkpoint and exit status {UNFINISHED}; `ifrdem resume` goes on",
    )


def _max_hours(given: str | None) -> float | None:
    if given is None:
        return None
    try:
        hours = float(given)
    except ValueError:
        hours = math.nan
    if not 0.0 < hours < math.inf:
        raise InputError(f"--maxh {given}: a positive number of hours is needed")
    return hours


def _add_case(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "case",
        metavar="CASE",
        help="a case file (TOML), or a shipped case (`ifrdem cases`); `ifrdem new cooling` writes one",
    )
    _add_set(parser)


def _add_set(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--set",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        dest="overrides",
        help="override a key of the case, such as run.seed=3 or species[0].number=100; repeatable. "
        "KEY= without a value removes the key",
    )


def _add_bench(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--n", metavar="N", help="disks of the elastic gas (default: 1e5)")
    parser.add_argument("--phi", metavar="PHI", help="its packing fraction (default: 0.3)")
    parser.add_argument("--arch", metavar="ARCH", help="device: cpu or cuda (see `ifrdem backends`)")
    parser.add_argument("--precision", metavar="P", help="f64 or f32")
    parser.add_argument("--threads", metavar="N", help="CPU threads (default: all cores)")
    parser.add_argument(
        "--skin",
        metavar="S",
        help="extra distance, in diameters of the largest disk, within which neighbours are listed",
    )
    parser.add_argument(
        "--runs", metavar="R", help="timed runs (default: 5); turns with --output (default: 24)"
    )
    parser.add_argument("--seconds", metavar="S", help="least length of a timed run (default: 0.5)")
    parser.add_argument("--seed", metavar="N", help="seed of the random numbers")
    parser.add_argument("--json", action="store_true", help="print one JSON object with every figure")
    parser.add_argument("--profile", action="store_true", help="measure the share of each kernel too")
    parser.add_argument(
        "--no-compile", action="store_true", help="leave out the times of a start, cold and warm"
    )
    parser.add_argument("--case", metavar="FILE", help="time the gas of a case file instead")
    parser.add_argument(
        "--after", metavar="C", help="collisions per disk that the case has before it is timed (default: 0)"
    )
    _add_set(parser)
    parser.add_argument(
        "--output",
        metavar="C",
        help="time what output costs a run, with its frames uncompressed (C = none) or compressed (gzip)",
    )
    parser.add_argument("--table", action="store_true", help="time a grid of gases; prints Markdown")
    parser.add_argument("--most", metavar="N", help="leave out gases of the table with more disks")
    parser.add_argument(
        "--clustered",
        action="store_true",
        help="in the table, a cooling gas in clusters too, which takes minutes",
    )


def _overrides(options: argparse.Namespace) -> list[str]:
    """What the command line changes of a case, the options with a name of their own included."""
    overrides = list(options.overrides)
    for key in ("arch", "seed", "threads", "precision"):
        value = getattr(options, key)
        if value is not None:
            # Texts are quoted, so that the model says what is wrong with "--arch 3" or an empty value.
            text = key in ("arch", "precision") or not value
            overrides.append(f"run.{key}={json.dumps(value) if text else value}")
    return overrides


def _run(options: argparse.Namespace) -> int:
    overrides, max_hours = _overrides(options), _max_hours(options.maxh)
    # Which files there will be is known only from the case, so a wrong case comes first.
    from ..case import file as case_file
    from ..case import shipped
    from ..run.outputs import Outputs

    file = case_file.read(shipped.find(options.case), overrides)
    picture = file.case.output.picture and not options.no_picture
    output = file.case.output
    views = output.views and "position" in output.fields
    outputs = Outputs.plan(file.case.run.name, options.output, picture=picture, views=views)
    outputs.check(force=options.force)  # before the imports below, which take a second

    from ..run.job import run
    from ..run.signals import Stopped
    from ..trajectory.writer import TrajectoryError

    try:
        run(file, outputs, force=options.force, max_hours=max_hours, say=_say, warn=_warn)
    except (TrajectoryError, Stopped) as error:
        _complain(str(error))
        return error.status if isinstance(error, Stopped) else FAILED
    return 0


def _resume(options: argparse.Namespace) -> int:
    max_hours = _max_hours(options.maxh)
    threads = options.threads
    if threads is not None and not (threads.isdecimal() and int(threads) > 0):
        raise InputError(f"--threads {threads}: a whole number, 1 or more, is needed")
    from ..run.resume import find, resume

    find(options.place)  # before anything takes a second
    from ..run.signals import Stopped
    from ..trajectory.writer import TrajectoryError

    try:
        resume(
            options.place, as_begun=options.as_begun, threads=threads and int(threads), max_hours=max_hours,
            picture=not options.no_picture, say=_say, warn=_warn,
        )  # fmt: skip
    except (TrajectoryError, Stopped) as error:
        _complain(str(error))
        return error.status if isinstance(error, Stopped) else FAILED
    return 0


def _tail(options: argparse.Namespace) -> int:
    return 0 if tail_options.run(options, say=_say) else FAILED


def _check(options: argparse.Namespace) -> int:
    from ..case import file as case_file
    from ..case import shipped
    from ..case import summary as check
    from ..case.estimate import Estimate
    from ..case.gas import Gas

    file = case_file.read(shipped.find(options.case), options.overrides)
    gas = Gas.from_case(file.case, file.folder)
    estimate = Estimate.of(gas, file.case)
    check.refuse_cadences(file.case, gas, estimate)
    _say(check.report(file.case, gas, estimate))
    try:
        check.refuse_beyond_disk(estimate.file_bytes, Path())
    except InputError as error:  # it may run elsewhere
        _warn(f"{error}: `ifrdem run` would refuse it here")
    return 0


def _bench(options: argparse.Namespace) -> int:
    from ..validation.speed.options import BenchOptions

    overrides = _overrides(options) if options.case is not None else []
    chosen = BenchOptions.parse(options, overrides)
    from ..case import file as case_file
    from ..case import shipped
    from ..validation.speed import bench, equilibrium
    from ..validation.speed import table as bench_table

    if chosen.table:
        bench_table.measure(chosen, say=_say, note=_complain)
        return 0
    if chosen.output is not None:
        from ..validation.speed import output_cost

        cost = output_cost.measure(
            chosen.n, chosen.phi, arch=chosen.arch, threads=chosen.threads, seed=chosen.seed,
            runs=chosen.timing.runs, compression=chosen.output, note=_complain,
        )  # fmt: skip
        _say(json.dumps(cost.figures(), indent=2) if chosen.json else cost.report())
        return 0
    if chosen.case is not None:
        file = case_file.read(shipped.find(chosen.case), overrides)
        found = bench.measure(
            file.case, file.folder, timing=chosen.timing, after=chosen.after, note=_complain
        )
    else:
        case = equilibrium.elastic_gas(
            chosen.n,
            chosen.phi,
            arch=chosen.arch,
            threads=chosen.threads,
            precision=chosen.precision,
            seed=chosen.seed,
        )
        try:
            found = bench.measure(case, timing=chosen.timing, note=_complain)
        except InputError as error:  # it speaks of a case that the user does not see
            raise InputError(f"--n {chosen.n} --phi {chosen.phi:g}: {error}") from None
    _say(json.dumps(found.figures(), indent=2) if chosen.json else found.report())
    return 0


def _validate(options: argparse.Namespace) -> int:
    from ..validation.report import runner

    if options.list:
        _say(runner.listing())
        return 0
    return runner.validate(
        options.names,
        options.output,
        quick=options.quick,
        force=options.force,
        seed=options.seed,
        jobs=None if options.jobs is None else whole("--jobs", options.jobs, 1),
        say=_say,
    )


def _fit(options: argparse.Namespace) -> int:
    return 0 if fit_options.run(options, say=_say, complain=_complain) else FAILED


def _info(options: argparse.Namespace) -> int:
    from ..run.info import describe

    _say(describe(options.file))
    return 0


def _new(options: argparse.Namespace) -> int:
    from ..case import shipped

    text = shipped.new(options.kind)
    if options.output == "-":
        print(text, end="")
        return 0
    path = Path(options.output or f"{Path(options.kind).stem}.toml")
    try:
        with path.open("w" if options.force else "x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise InputError(f"{path}: exists already; --force replaces it, -o writes elsewhere") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None
    quoted = shlex.quote(str(path))
    _say(f"wrote {path}: look at it with `ifrdem check {quoted}`, run it with `ifrdem run {quoted}`")
    return 0


def _cases(options: argparse.Namespace) -> int:
    from ..case import shipped

    _say(shipped.listing())
    return 0


def _docs(options: argparse.Namespace) -> int:
    from .docs import show

    _say(show(options.topic))
    return 0


def _backends(options: argparse.Namespace) -> int:
    from .. import bullet
    from ..simulation import device as backend

    for device in backend.available():
        _say(f"{device.arch:<8} {device.description}")
    absence = backend.cuda_absence()
    if absence is not None:
        _say(f"cuda     not usable: {absence}")
    _say(f"pybullet {bullet.describe()}")
    return 0
