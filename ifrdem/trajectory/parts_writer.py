"""A writer of trajectories in parts (`parts`): each rank of MPI writes some disks, the first one also NAME.h5."""

from __future__ import annotations

import contextlib
import os
import secrets
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, TrajectoryError, option_name
from ..model.box import Box
from ..model.state import Disks, FrameRows, State
from ..mpi import Communicator, current
from ..mpi.distribution import bounds
from ..quantities import FIELDS
from ..tools.checked import Comm, Count, must_be, validated
from ..tools.read_only import NotCopied
from . import layout
from . import parts as part_files
from .background import AsyncWriter
from .parts import Parts
from .species import named_species, with_species
from .writer import DEFAULT_FIELDS, TrajectoryWriter


class PartsWriter(NotCopied):
    """Writer of a trajectory in parts, in separate threads, with the methods of `AsyncWriter`.

    Each of P ranks writes its part, with the disks that it has (r n // P and following of n), as a trajectory of its
    own; the first one also writes NAME.h5. A frame counts when NAME.h5 has it: it gets there in `commit`, when all
    ranks have reported that it is complete in their parts and flushed. A killed process therefore leaves in NAME.h5
    only frames that are complete in all parts; parts may hold more.

    A resumed file keeps its parts: of P' ranks then, number p % P' writes part p, and gets its rows from
    the ranks that have them (`shares`).

    All ranks call `create` or `resume`, `write` (or `shares` and `commit`) and `flush`; without `comm` one process
    writes everything. Use it as a context manager: leaving it commits all that was given.

    Examples
    --------
    >>> import ifrdem
    >>> disks = ifrdem.Disks(2, mass=1.0, radius=0.5)
    >>> box = ifrdem.Box((10.0, 10.0))
    >>> state = ifrdem.State([[1.0, 5.0], [4.0, 5.0]], [[1.0, 0.0], [0.0, 0.0]], spin=[0.0, 0.0])
    >>> with ifrdem.PartsWriter.create("gas.h5", disks, disks, box, number=2) as file:
    ...     file.write(state, {"temperature": 0.25})
    ...
    >>> ifrdem.Trajectory("gas.h5")[0].position.tolist()
    [[1.0, 5.0], [4.0, 5.0]]
    """

    _instead = TrajectoryWriter._instead

    def __init__(
        self,
        parts: Parts,
        own: Mapping[int, TrajectoryWriter],
        head: TrajectoryWriter | None,
        fields: Sequence[str],
        comm: Communicator,
        path: Path,
    ) -> None:
        self.parts = parts
        self.path = path
        self._comm = comm
        self._own = {number: AsyncWriter(each) for number, each in own.items()}
        self._head = None if head is None else AsyncWriter(head)
        self._attributes = {"position", *(FIELDS[name].name for name in fields)}
        self._waiting: list[tuple[FrameRows, Mapping[str, ArrayLike] | None]] = []
        self._counted = 0 if self._head is None else int(self._head.written_counts["frames"])

    @classmethod
    @validated
    def create(
        cls,
        path: str | os.PathLike[str] | None,
        disks: Disks,
        own: Disks,
        box: Box | None,
        *,
        comm: Comm = None,
        number: Count | None = None,
        force: bool = False,
        parameters: Mapping[str, str | int | float] | None = None,
        fields: Sequence[str] = DEFAULT_FIELDS,
        **options: Any,
    ) -> PartsWriter:
        """Begin a trajectory in so many parts, by default one for each rank.

        `disks` give the number of all, `own` are those of this rank; all else is as `TrajectoryWriter` has it, and
        counts on the first rank only. `parameters` stand in NAME.h5 alone. `force` removes a trajectory that is there,
        with its parts, at once: there might be no room for both.

        Raises InputError, on all ranks, as `TrajectoryWriter`, or if a rank has no disk; nothing is left behind then.
        """
        ranks = Communicator.of(comm)
        species = named_species(with_species(parameters, disks.species), disks.n) or {}
        given: Any = ranks.bcast(
            None if path is None else (Path(path), box, fields, options, tuple(species.values()))
        )
        output_path, box, fields, options, of_species = given

        def begin() -> Parts:
            if number is not None and number > max(disks.n, ranks.size):
                raise must_be("number", number, f"at most the number of disks, {disks.n}")
            if force:
                part_files.remove(output_path)
            folder = part_files.folder_of(output_path)
            if old_parts := part_files.existing(output_path):
                how = option_name("--force", "force=True")
                raise InputError(f"output {old_parts[0]} exists: choose another name, or replace it ({how})")
            try:
                folder.mkdir(exist_ok=True)
            except OSError as error:
                raise InputError(f"output {folder}: cannot be made: {error.strerror}") from error
            first = bounds(disks.n, number or ranks.size).tolist()
            return Parts(folder.name, secrets.token_hex(16), tuple(first))

        def part(i: int, of: Disks) -> TrajectoryWriter:
            name, mark = output_path.parent / parts.name(i), replace(parts.part(i), species=of_species)
            return TrajectoryWriter(name, of, box, fields=fields, within=mark, **options)

        def head() -> TrajectoryWriter:
            return TrajectoryWriter(
                output_path,
                disks,
                box,
                fields=fields,
                parameters=parameters,
                force=force,
                within=parts,
                **options,
            )

        with contextlib.ExitStack() as undo:
            undo.callback(_remove_empty, output_path)
            parts = ranks.root_result(begin)
            with ranks:
                here = _each_part(parts, own, part, undo)
            first = ranks.run_on_root(head)
            undo.pop_all()
        return cls(parts, here, first, fields, ranks, output_path)

    @classmethod
    def resume(
        cls, head: TrajectoryWriter | None, own: Disks, box: Box | None, *, comm: Any = None, frames: int = 0,
        fields: Sequence[str] = DEFAULT_FIELDS, **options: Any,
    ) -> PartsWriter:  # fmt: skip
        """Continue a trajectory on any number of ranks.

        `head` is NAME.h5, as `TrajectoryWriter.resume` has opened it on the first rank, which has seen that all parts
        are there; it is the caller's to close if this fails. `own` are the disks of this rank; all else is as given
        there, and counts on the first rank only.

        Raises InputError, on all ranks, if a part cannot be continued, as `TrajectoryWriter.resume`.
        """
        options |= {"frames": frames}
        given: Any = None if head is None else (head.path, head.parts, box, fields, options)
        ranks = Communicator.of(comm)
        output_path, parts, box, fields, options = ranks.bcast(given)

        def part(i: int, of: Disks) -> TrajectoryWriter:
            return TrajectoryWriter.resume(
                output_path.parent / parts.name(i), of, box, fields=fields, **options
            )

        with contextlib.ExitStack() as undo:
            with ranks:
                here = _each_part(parts, own, part, undo)
            undo.pop_all()
        return cls(parts, here, head, fields, ranks, output_path)

    def shares(self, state: State | FrameRows) -> FrameRows:
        """Rows for the parts that this rank writes, one part after another, of this rank's disks; called by all."""
        frame = state if isinstance(state, FrameRows) else FrameRows.of(state, sorted(self._attributes))
        with self._comm:
            (rows,) = _for_own_parts(self.parts, [frame.rows])
        return FrameRows(frame.time, rows)

    def write(self, state: State, observables: Mapping[str, ArrayLike] | None = None) -> None:
        """Append a frame of this rank's disks; called by all ranks, of which the first one's `observables` are kept.

        Raises InputError and TrajectoryError as `AsyncWriter`: what went wrong with an earlier frame.
        """
        self.write_frames([(self.shares(state), observables)])
        self.commit()

    def write_frames(self, frames: Sequence[tuple[FrameRows, Mapping[str, ArrayLike] | None]]) -> None:
        """Give frames, of `shares`, to the parts of this rank, and keep their observables until `commit`."""
        own = _own_parts(self.parts, self._comm)
        for number, queue in self._own.items():
            queue.write_frames([(FrameRows(each.time, each.rows[own[number]]), None) for each, _ in frames])
        if self._head is not None:
            for each, observables in frames:  # NAME.h5 has no fields
                self._waiting.append((FrameRows(each.time, np.empty(self.parts.n, [])), observables))

    def commit(self) -> None:
        """Commit the frames that are whole in all parts; called by all ranks."""
        done = min((int(queue.written_counts["frames"]) for queue in self._own.values()), default=sys.maxsize)
        done = min(self._comm.allgather(done))
        if self._head is not None and done > self._counted:
            new, self._counted = done - self._counted, done
            frames, self._waiting = self._waiting[:new], self._waiting[new:]
            self._head.write_frames(frames)

    def raise_error(self) -> None:
        """Raise the error of a thread of this rank."""
        for queue in self._queues:
            queue.raise_error()

    def flush(self) -> None:
        """Wait until all given frames are committed; called by all ranks, which all raise the error of one."""

        def own() -> None:
            for queue in self._own.values():
                queue.flush()

        self._comm.run_on_all(own)
        self.commit()
        self._comm.run_on_root(self._head.flush if self._head is not None else lambda: None)

    def close(self) -> None:
        """Close the files of this rank; what is not committed does not count. May be called twice."""
        error: TrajectoryError | InputError | None = None
        for queue in reversed(self._queues):  # NAME.h5 last
            try:
                queue.close()
            except (TrajectoryError, InputError) as raised:
                error = error or raised
        if self._head is not None and not self.path.exists():  # without a frame, it is gone
            part_files.remove(self.path)
        _remove_empty(self.path)
        if error is not None:
            raise error

    def __enter__(self) -> PartsWriter:
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        try:
            if error is None:
                self.flush()
        finally:
            with contextlib.suppress(*(() if error is None else (TrajectoryError,))):
                self.close()

    @property
    def _queues(self) -> list[AsyncWriter]:
        return [*([] if self._head is None else [self._head]), *self._own.values()]

    def __len__(self) -> int:
        """Number of committed frames, on the first rank."""
        return 0 if self._head is None else len(self._head)

    def __getattr__(self, name: str) -> Any:
        """Attribute of the writer of NAME.h5, which has series and histories."""
        if name.startswith("_") or self._head is None:
            raise AttributeError(name)
        return getattr(self._head, name)

    @property
    def replaced_or_removed(self) -> str | None:
        """Reason why a file of this rank is not at its place any more; None if all are."""
        return next((reason for queue in self._queues if (reason := queue.replaced_or_removed)), None)

    @property
    def seconds(self) -> float:
        """Processor time that the threads of this rank have taken."""
        return sum(queue.seconds for queue in self._queues)


def _each_part(
    parts: Parts,
    own: Disks,
    make: Callable[[int, Disks], TrajectoryWriter],
    undo: contextlib.ExitStack,
) -> dict[int, TrajectoryWriter]:
    """A writer for each part that this rank writes, by its number; `undo` closes them."""
    columns = _for_own_parts(parts, [getattr(own, name) for name in layout.STATIC])
    rows_of = _own_parts(parts, current())

    def all_made() -> dict[int, TrajectoryWriter]:
        found = {}
        for number, rows in rows_of.items():
            each = [column[rows] for column in columns]
            of_part: dict[str, Any] = dict(zip(layout.STATIC, each, strict=True))
            found[number] = make(number, Disks(len(each[0]), **of_part))
            undo.callback(found[number].close)
        return found

    return current().run_on_all(all_made)


def _for_own_parts(parts: Parts, rows: list[NDArray[Any]]) -> list[NDArray[Any]]:
    """Rows of the disks of all ranks, each of which has its own, as rows of the parts that this one writes."""
    ranks = current()
    if parts.first == tuple(bounds(parts.n, ranks.size).tolist()):
        return rows
    ids = np.array(ranks.slice_of(parts.n))
    return ranks.exchange((np.searchsorted(parts.first, ids, side="right") - 1) % ranks.size, rows)


def _own_parts(parts: Parts, ranks: Communicator) -> dict[int, slice]:
    """Slice of the rows of this rank that belong to each part that it writes, by the part's number."""
    found, at = {}, 0
    for number in range(ranks.rank, len(parts), ranks.size):
        end = at + parts.first[number + 1] - parts.first[number]
        found[number] = slice(at, end)
        at = end
    return found


def _remove_empty(path: Path) -> None:
    """Remove the folder of parts if nothing is in it."""
    with contextlib.suppress(OSError):
        part_files.folder_of(path).rmdir()
