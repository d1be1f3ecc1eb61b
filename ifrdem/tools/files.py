"""Output files: checks, locks, and atomic writing."""

from __future__ import annotations

import contextlib
import errno
import io
import json
import os
import platform
import secrets
import shlex
import stat
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import BinaryIO

from ..errors import InputError, cut, option_name, printable, refuse
from . import text_file

try:
    import fcntl
    import grp
    import pwd
except ImportError:  # not on Windows
    fcntl = grp = pwd = None  # type: ignore[assignment]

CHECKPOINT = ".checkpoint.h5"
"""Ending of the checkpoint of a run, next to its trajectory."""
VIEWS = (".vtkhdf", ".nc")
"""Endings of the files that let other programs read a trajectory (`views.py`)."""
NO_VALUES = "This is a netCDF dimension but not a netCDF variable."
"""Name of an axis without values in NetCDF-4 files, in their own notation."""
STATUS = ".status.json"
"""Ending of the file with the live state of a run, next to its trajectory."""
MOST_STATUS = 1 << 20  # bytes of a status file at most
REMEDIES = {
    errno.ENOSPC: "free some space there, or write to another disk",
    errno.EDQUOT: "delete some of your files there, or write to another disk",
    errno.EFBIG: "allow larger files (`ulimit -f`), or write to another disk",
    errno.EIO: "the drive or its connection has failed; write to another disk",
    **dict.fromkeys((errno.EROFS, errno.EACCES, errno.EPERM), "write into another folder"),
}
"""Remedies, by errno, where the system does not write a file."""

# Device and inode of each file that this process has locked to write it.
_locked: set[tuple[int, int]] = set()


def lock(descriptor: int, path: str | os.PathLike[str], *, shared: bool = False) -> None:
    """Lock an open file until its descriptor is closed; `shared` locks exclude only those that are not.

    Raises BlockingIOError that names the process that has locked it. On Windows nothing is locked.
    """
    if fcntl is None:
        return
    try:
        fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except BlockingIOError:
        raise _in_use(_use(descriptor, path)) from None
    if not shared:
        _locked.add(_key(descriptor))


def unlock(descriptor: int) -> None:
    """Drop the lock of a descriptor that is about to be closed."""
    _locked.discard(_key(descriptor))


class Hold:
    """A lock on a file that is about to be replaced, until `close`; none if it cannot be read or locked.

    While another process reads the file, it is locked only against processes that write it.

    Raises BlockingIOError that names the process that writes it.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._descriptor: int | None = None
        if fcntl is None:
            return
        with contextlib.suppress(OSError):  # a file that cannot be read can still be replaced
            self._descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        if self._descriptor is None:
            return
        try:
            try:
                lock(self._descriptor, path)
            except BlockingIOError:
                lock(self._descriptor, path, shared=True)
        except BlockingIOError:
            self.close()
            raise
        except OSError:  # a file system without locks
            self.close()

    def close(self) -> None:
        """Release the lock."""
        descriptor, self._descriptor = self._descriptor, None
        if descriptor is not None:
            unlock(descriptor)
            os.close(descriptor)


def being_written(path: str | os.PathLike[str]) -> str | None:
    """Text on the process that is writing a file, such as "process 41 on node7 is writing it"; None if none is.

    Readers lock files as well, which does not count: a file that is replaced stays whole for readers that have it open.
    """
    if fcntl is None or not os.path.isfile(path):
        return None
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)  # a pipe in its place is not waited for
    except OSError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return _use(descriptor, path)
    except OSError:  # a file system without locks
        return None
    finally:
        os.close(descriptor)
    return None


def is_locked_here(path: str | os.PathLike[str]) -> bool:
    """True if this process has locked a file to write it."""
    try:
        found = os.stat(path)
    except OSError:
        return False
    return (found.st_dev, found.st_ino) in _locked


def _key(descriptor: int) -> tuple[int, int]:
    found = os.fstat(descriptor)
    return found.st_dev, found.st_ino


def _in_use(use: str) -> BlockingIOError:
    return BlockingIOError(errno.EWOULDBLOCK, use)


def _use(descriptor: int, path: str | os.PathLike[str]) -> str:
    """Text on the process that has locked an open file, from the kernel's list or the status file of its run."""
    if (key := _key(descriptor)) in _locked:
        return "this process is writing it"
    host, found = platform.node(), {}
    with contextlib.suppress(OSError, ValueError), open("/proc/locks", encoding="ascii") as locks:
        for line in locks:  # 1: FLOCK  ADVISORY  WRITE 9646 fe:00:2146383 0 EOF
            _, kind, *_, mode, process, inode_text, _, _ = line.split()
            major, minor, inode = inode_text.split(":")
            if kind == "FLOCK" and int(inode) == key[1] and int(process) > 0:
                what = "is writing it" if mode == "WRITE" else "has it open"
                found[int(major, 16), int(minor, 16)] = f"process {process} on {host} {what}"
    if found:  # some file systems have other device numbers here than in `stat`
        return found.get((os.major(key[0]), os.minor(key[0])), next(iter(found.values())))
    whole = Path(path)
    status = whole.with_name(whole.name.removesuffix(".h5") + STATUS)
    with contextlib.suppress(OSError, ValueError, TypeError, LookupError, RecursionError):
        record = json.loads(text_file.read(status, most=MOST_STATUS))
        if record["state"] == "running":
            return f"process {int(record['pid'])} on {printable(cut(str(record['host'])))} is writing it"
    return "another process is writing it"


def make_private(folder: Path) -> None:
    """Create a folder and those that it is in, for this user only. Raises OSError if one cannot be created."""
    for each in (*reversed(folder.parents), folder):  # `parents=True` would give the others the usual mode
        if not each.is_dir():
            each.mkdir(mode=0o700, exist_ok=True)


def writable_by_others(folder: Path) -> str | None:
    """Clause on who besides this user and root may change what a folder holds; None if no one may, or on Windows.

    Who may write a folder that it is in may put another one in its place, unless the sticky bit forbids it. This is the
    rule of OpenSSH for its keys, but for that bit. The root of all folders is left out: who may write it, could replace
    the system. Raises OSError if the system does not say.
    """
    if pwd is None or grp is None:
        return None
    given, real = folder.absolute(), Path(os.path.realpath(folder))  # links count, and where they lead
    for place in dict.fromkeys((real, given, *real.parents, *given.parents)):
        itself = place in (real, given)
        if place != place.parent and (who := _others(place, "it" if itself else str(place), held=not itself)):
            return who
    return None


def _others(place: Path, name: str, *, held: bool) -> str | None:
    """Clause on who besides this user and root may write a folder, or replace a link; None if no one may.

    With `held`, a sticky bit is enough. The group that many systems make for each user, of the same name, counts as the
    user.
    """
    found, user = place.lstat(), os.geteuid()
    if found.st_uid not in (user, 0):
        return f"{name} belongs to another user"
    if stat.S_ISLNK(found.st_mode) or (held and found.st_mode & stat.S_ISVTX):
        return None
    if found.st_mode & stat.S_IWOTH:
        return f"every user may write {name}"
    if found.st_mode & stat.S_IWGRP:
        try:
            owner, group = pwd.getpwuid(user).pw_name, grp.getgrgid(found.st_gid)
        except KeyError:  # without an entry
            return f"its group may write {name}"
        if group.gr_name != owner or set(group.gr_mem) - {owner}:
            return f"its group may write {name}"
    return None


def reason(error: BaseException) -> str:
    """Reason why a file could not be written, as the system or a library names it."""
    return (isinstance(error, OSError) and error.strerror) or str(error) or type(error).__name__


def remedy(error: BaseException) -> str:
    """Clause of a message on what helps then; an empty text if that is unknown."""
    known = isinstance(error, OSError) and error.errno in REMEDIES
    return f"; {REMEDIES[error.errno]}" if known else ""  # type: ignore[attr-defined]  # an OSError


def cause(error: BaseException) -> str:
    """Reason why a file could not be written, and what helps."""
    return f"{reason(error)}{remedy(error)}"


def create(path: Path) -> Path:
    """Create an empty file next to a path, under a name that no file or link has; returns its path.

    Raises OSError if it cannot be created.
    """
    created = path.with_name(f".{path.name[:50]}.{secrets.token_hex(4)}.part")
    flags = os.O_CREAT | os.O_EXCL | os.O_RDWR | getattr(os, "O_NOFOLLOW", 0)
    os.close(os.open(created, flags, 0o666))
    return created


@contextlib.contextmanager
def replacing(path: Path, *, synced: bool = True) -> Iterator[Path]:
    """A new file to be filled, which takes its place at the end; after an exception nothing is left of it.

    It is on the disk before it takes the place, unless `synced` is false: a file system may say only then that it has
    no room, and after a power failure the place holds the old file or the new one.

    Raises BlockingIOError if a process writes the file that is there.
    """
    if use := being_written(path):
        raise _in_use(use)
    new = create(path)
    try:
        yield new
        if synced:
            with open(new, "rb") as written:
                os.fsync(written.fileno())
        if use := being_written(path):  # a run may have started meanwhile
            raise _in_use(use)
        os.replace(new, path)
    finally:
        new.unlink(missing_ok=True)


def check_apart(path: Path, trajectory: Path, option: str | None = None) -> None:
    """Refuse an output that would replace the trajectory that it is made of.

    Raises InputError if both are one file.
    """
    if path.exists() and path.samefile(trajectory):
        option = option or option_name("-o", "another output")
        raise InputError(f"output {path}: is the trajectory itself; {option} writes elsewhere")


def _checkpoint_in_use(path: Path) -> str | None:
    """Text on the process whose run writes this checkpoint from time to time; None if none does."""
    if not path.name.endswith(CHECKPOINT):
        return None
    return being_written(path.with_name(path.name.removesuffix(CHECKPOINT) + ".h5"))


def check_files(paths: Sequence[Path], *, force: bool, elsewhere: str | None = None) -> None:
    """Refuse files that exist (unless `force`), that a process is writing, or that cannot be written.

    Raises InputError with a line for each thing that is wrong; `elsewhere` says how to choose another place. Nothing is
    left behind.
    """
    problems = []
    elsewhere = elsewhere or option_name("-o writes elsewhere", "another output writes elsewhere")
    replaces = option_name("--force replaces it", "force=True replaces it")
    for path in paths:
        if special := not_a_file(path):
            problems.append(special)
        elif use := being_written(path) or _checkpoint_in_use(path):
            problems.append(f"output {path}: {use}: wait for it or stop it first; {elsewhere}")
        elif path.exists() and not force:
            if path.suffix == ".h5" and checkpoint_of(path).exists():
                resumes = f"`ifrdem resume {shlex.quote(str(path))}` continues it"
                problems.append(
                    f"output {path}: holds an interrupted run: {resumes}; {replaces}, {elsewhere}"
                )
            else:
                problems.append(f"output {path}: exists already; {replaces}, {elsewhere}")
    for folder in dict.fromkeys(path.parent for path in paths):
        if not os.path.exists(folder):  # where `Path.exists` raises the error of a name that is too long
            problems.append(f"output folder {folder}: does not exist")
        elif not folder.is_dir():
            problems.append(f"output folder {folder}: is not a folder")
        else:
            try:  # asking for permissions would be wrong for root, and on read-only file systems
                tempfile.TemporaryFile(dir=folder, prefix=".ifrdem-").close()
            except OSError as error:
                problems.append(f"output folder {folder}: cannot be written to: {cause(error)}")
    refuse(problems)


def write_aside(path: Path, write: Callable[[Path], object]) -> None:
    """Let `write` write a temporary file next to `path`, and rename it: the file appears whole or not at all.

    For files that may be larger than the memory; `write_bytes` for others.

    Raises InputError if the place is a folder, a device or a pipe, which nothing must take the place of, or cannot be
    written.
    """
    if special := not_a_file(path):
        raise InputError(special)
    try:
        with replacing(path) as new:
            write(new)
    except OSError as error:
        raise InputError(f"output {path}: cannot be written: {cause(error)}") from error


def write_bytes(path: Path, content: bytes) -> None:
    """Write bytes, whole or not at all; InputError as `write_aside`."""
    write_aside(path, lambda aside: aside.write_bytes(content))


def write_saved(path: Path, save: Callable[[BinaryIO], object]) -> None:
    """Let a library save into memory, and write that, whole or not at all; InputError as `write_aside`.

    Many libraries do not end well when they write to a full disk themselves.
    """
    held = io.BytesIO()
    save(held)
    write_bytes(path, held.getvalue())


def write_text(path: Path, text: str) -> None:
    """Write a text in UTF-8, whole or not at all; InputError as `write_aside`."""
    write_aside(path, lambda aside: aside.write_text(text, encoding="utf-8"))


def not_a_file(path: Path) -> str | None:
    """Reason why a path cannot be an output; None for files and free paths."""
    try:
        path.stat()
    except OSError as error:
        if error.errno in (errno.ENAMETOOLONG, errno.ELOOP):
            return f"output {path}: {error.strerror}"
    if path.is_dir():
        return f"output {path}: is a folder"
    if path.exists() and not path.is_file():
        return f"output {path}: is a device or pipe, no file that could be replaced"
    return None


def checkpoint_of(trajectory: Path) -> Path:
    """The checkpoint that belongs to a trajectory, NAME.checkpoint.h5 for NAME.h5."""
    return trajectory.with_name(trajectory.name.removesuffix(".h5") + CHECKPOINT)
