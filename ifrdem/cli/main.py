"""The command `ifrdem`. A command imports what it needs when it is called: `--help` starts nothing."""

from __future__ import annotations

import errno
import gc
import inspect
import os
import sys
import textwrap
import time
import traceback
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

from cyclopts import (
    App,
    CycloptsError,
    Group,
    MissingArgumentError,
    Parameter,
    UnknownCommandError,
    UnknownOptionError,
    UnusedCliTokensError,
)

from .. import mpi
from ..errors import EngineError, InputError, cut, nearest, on_command_line, there_are
from ..tools.arguments import forget, unfailing_messages
from ..tools.files import check_files
from ..tools.versions import shown
from . import analyse, console, fit, program, run, trajectory
from .console import BAD_INPUT, FAILED, INTERRUPTED, LOG, complain
from .options import flag

RUNS = Group("Cases and runs", sort_key=1)
FILES = Group("Trajectories", sort_key=2)
LAW = Group("Law and program", sort_key=3)
EVERY = Group("Every command", sort_key=9)


class _Program(App):
    """The program, whose script of completions takes the place of no file of the user's."""

    def install_completion(
        self, *, shell: Any = None, output: Path | None = None, add_to_startup: bool = True
    ) -> Path:
        """Write the script and return its path; InputError if a given path is taken."""
        if output is not None:
            if os.path.lexists(output):
                raise InputError(f"-o {output}: exists already; must be a new file")
            check_files([output.absolute()], force=False)
        return super().install_completion(shell=shell, output=output, add_to_startup=add_to_startup)


app: App = _Program(
    name="ifrdem",
    help="Event-exact simulation of granular gases of rough disks that collide by the independent "
    "friction-restitution law.",
    version=shown,
    help_format="plaintext",
    default_parameter=Parameter(
        negative_bool=(),
        negative_iterable=(),
        negative_none=(),
        show_default=False,
        show_choices=False,
        allow_repeating=True,
    ),
    result_action="return_value",
    suppress_keyboard_interrupt=False,
    group_commands=EVERY,
    group_arguments=Group("Arguments", sort_key=0),
    group_parameters=Group("Options", sort_key=1),
)


GENERAL = ("--quiet", "--verbose", "--help")


COMMANDS: dict[Group, tuple[Callable[..., Any], ...]] = {
    RUNS: (run.run, run.resume, run.status, run.study, run.check, run.new, run.cases),
    FILES: (
        trajectory.info, trajectory.view, analyse.analyse, analyse.plot, trajectory.movie, trajectory.history,
        trajectory.export, trajectory.link, trajectory.repair,
    ),
    LAW: (
        fit.collisions, fit.fit, fit.compare, program.validate, program.bench, program.devices,
        program.docs,
    ),
}  # fmt: skip
MORE: dict[Callable[..., Any], str] = {
    fit.fit: fit.FORMAT,
    fit.collisions: fit.TRACKS,
    fit.compare: fit.MEASURED,
    analyse.analyse: f"WHAT is\n\n{textwrap.indent(analyse.ANALYSIS_LIST, '  ')}",
    analyse.plot: f"WHAT is drawn into a PNG file:\n\n{textwrap.indent(analyse.PICTURE_LIST, '  ')}",
}
"""Text that `--help` of a command shows behind its docstring."""


def _unwrapped(text: str) -> str:
    """A text whose paragraphs are lines, which are wrapped where they are shown; indented lines stay as they are."""
    paragraphs = text.strip().split("\n\n")
    return "\n\n".join(each if each.startswith(" ") else " ".join(each.split()) for each in paragraphs)


for _group, _functions in COMMANDS.items():
    for _position, _function in enumerate(_functions):
        _text = f"{inspect.cleandoc(_function.__doc__ or '')}\n\n{MORE.get(_function, '')}"
        app.command(_function, help=_unwrapped(_text), group=_group, sort_key=_position)
app.register_install_completion_command(add_to_startup=False)  # what a shell's start file needs is printed


app.meta.suppress_keyboard_interrupt = False


@app.meta.default
def _any(
    *words: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
    quiet: Annotated[
        bool, flag("show results, warnings and errors only", "--quiet", "-q", group=EVERY)
    ] = False,
    verbose: Annotated[
        bool, flag("show details too: device, kernel cache, times", "--verbose", "-v", group=EVERY)
    ] = False,
) -> object:
    if quiet and verbose:
        raise InputError("--quiet: cannot be combined with --verbose")
    console.set_level(quiet=quiet, verbose=verbose)
    _refuse_empty(words)
    return app(words or ("--help",), exit_on_error=False, print_error=False)


def _refuse_empty(words: Sequence[str]) -> None:
    """Raise InputError for a text that is empty or has a NUL character, which no argument or option takes."""
    for place, word in enumerate(words):
        option, equals, value = word.partition("=") if word.startswith("-") else ("", "=", word)
        if equals and (not value or "\0" in value):
            if not option:
                before = words[place - 1] if place else ""
                option = before if before.startswith("-") else f"argument {place} of `ifrdem {words[0]}`"
            option = option if place else "COMMAND"
            raise InputError(f"{option} {value!r}: must be a text, not empty and without NUL characters")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status.

    0, 1 (failed), 2 (bad input), 3 (stopped by --max-hours or SIGUSR1, SIGUSR2), 130 (interrupted), 143 (terminated).
    """
    given = sys.argv[1:] if arguments is None else list(arguments)
    if arguments is None:  # a process of its own: imports and the syntax trees of kernels leave no garbage
        gc.set_threshold(10_000)
    if sys.stdout is None:  # closed by the caller, as by `>&-`
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115 (as long as the process)
    started = time.perf_counter()
    with unfailing_messages(), console.shown(), on_command_line():
        try:
            with warnings.catch_warnings():
                warnings.showwarning = lambda message, *_args, **_options: console.warn(str(message))
                status = app.meta(given, exit_on_error=False, print_error=False)
            LOG.debug("done in %.1f s", time.perf_counter() - started)
            sys.stdout.flush()  # here, where a broken pipe is caught
            return int(status or 0)
        except CycloptsError as error:
            return mpi.communicator.end(BAD_INPUT, _message(error), complain)
        except InputError as error:
            return mpi.communicator.end(BAD_INPUT, str(error), complain)
        except EngineError as error:
            return mpi.communicator.end(FAILED, f"the engine stopped: {error}", complain)
        except KeyboardInterrupt as error:
            return mpi.communicator.end(INTERRUPTED, str(error) or "interrupted", complain)
        except BrokenPipeError:  # the reader of our output went away, as `head` does
            forget(sys.stdout)
            return FAILED
        except OSError as error:  # such as a full disk; files have their own messages
            text = (
                f"{error.strerror or error}{f': {cut(str(error.filename), 300)}' if error.filename else ''}"
            )
            if error.errno == errno.ENAMETOOLONG:
                return mpi.communicator.end(BAD_INPUT, text, complain)
            forget(sys.stdout)
            return mpi.communicator.end(FAILED, text, complain)
        except Exception:
            # A fault of the program. A single process raises it; one rank of several prints it, with the traceback,
            # and ends all the others, which would wait for ever.
            if mpi.communicator.is_single_process():
                raise
            return mpi.communicator.end(FAILED, traceback.format_exc(), complain)


def _commands() -> list[str]:
    return [name for name in app if not name.startswith("-")]


def _message(error: CycloptsError) -> str:
    """The message on a command line that cannot be understood."""
    if isinstance(error.__cause__, InputError):  # of a converter
        return str(error.__cause__)
    if isinstance(error, UnknownCommandError):
        word, known = (error.unused_tokens or [""])[0], _commands()
        if not word.startswith("-"):
            return f"unknown command '{word}'{there_are(word, known)}"
        text = f"unknown option {word}{nearest(word, [*GENERAL, *(name for name in app if name not in _commands())])}"
    elif isinstance(error, UnknownOptionError):
        word = (error.token.keyword or error.token.value).partition("=")[0]
        allowed = [name for each in error.argument_collection for name in each.names if name.startswith("-")]
        text = f"unknown option {word}{nearest(word, [*allowed, *GENERAL])}"
    elif isinstance(error, UnusedCliTokensError):
        text = f"unexpected argument '{(error.unused_tokens or [''])[0]}'"
    elif isinstance(error, MissingArgumentError) and error.argument is not None:
        text = f"{error.keyword or error.argument.name}: must have a value"
    else:
        text = str(error)
    return f"{text} (see `{' '.join(('ifrdem', *(error.command_chain or ())))} --help`)"
