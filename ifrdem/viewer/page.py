"""The page: blank, as the server sends it, or with the frames inside, as one file and for notebooks."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import re
import zlib
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..tools import checked
from ..tools.checked import validated
from ..tools.files import write_text
from ..trajectory.reader import Trajectory
from .content import MOST_DISKS, Content, pack

MOST_EVENTS = 20_000
"""Collisions of tracked disks that a file holds, shared evenly."""
NOTEBOOK_DISKS, NOTEBOOK_FRAMES = 1_000_000, 100
"""Disks times frames, and frames, that a notebook shows by default: some 10 MB."""
MOST_FRAMES, MOST_HEIGHT = 2**31, 100_000
WHOLE_EVERY = 32
"""Frames of a file of which the first does not need the one before it."""
POLICY, DATA = "<!-- policy -->", "<!-- data -->"


@cache
def blank() -> str:
    """The page without data, which asks its server for them."""
    return Path(__file__).with_name("page.html").read_text(encoding="utf-8")


@cache
def policy(connect: str) -> str:
    """Content-Security-Policy of the page: its own script and style, no other; `connect` is where data come from."""
    hashes = {
        tag: base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        for tag, text in re.findall(r"<(script|style)>(.*?)</\1>", blank(), flags=re.DOTALL)
    }
    return (
        f"default-src 'none'; script-src 'sha256-{hashes['script']}'; style-src 'sha256-{hashes['style']}'; "
        f"img-src data:; connect-src {connect}; base-uri 'none'; form-action 'none'"
        + ("; frame-ancestors 'none'" if connect != "'none'" else "")
    )


def page(
    trajectory: Trajectory, frames: Sequence[int], progress: Callable[[Sequence[int]], Iterable[int]] = iter
) -> str:
    """The page with these frames inside, deflated, for any browser.

    Raises InputError if there is no frame, or there are too many disks.
    """
    content = Content(trajectory)
    if not len(frames):
        raise InputError(f"{trajectory.path}: no frame to show")
    if trajectory.n > MOST_DISKS:
        raise InputError(
            f"{trajectory.path}: {trajectory.n} disks are too many for one file ({MOST_DISKS} at most)"
        )
    head = content.head(frames[0])
    share = MOST_EVENTS // max(len(head["tracked"]), 1)
    head |= {"times": [head["times"][i] for i in frames], "status": ""}
    histories = {
        id: content.collisions(id, float(trajectory.times[frames[-1]]), share) for id in head["tracked"]
    }
    blocks = {
        "head": _script(head),
        "histories": _script(histories),
        "disks-data": _deflated(content.disks()),
    }
    colours = [one["name"] for one in head["colours"]]
    before: dict[str, NDArray[Any]] = {}
    for position, index in enumerate(progress(frames)):
        header, arrays = content.frame(index, colours)
        stored = {} if position % WHOLE_EVERY == 0 else _differences(arrays, before, trajectory.n)
        blocks[f"frame-{position}"] = _deflated(pack(header | {"differences": [*stored]}, arrays | stored))
        before = arrays
    data = "\n".join(f'<script type="text/plain" id="{id}">{text}</script>' for id, text in blocks.items())
    meta = f'<meta http-equiv="Content-Security-Policy" content="{html.escape(policy(chr(39) + "none" + chr(39)))}">'
    return blank().replace(POLICY, meta).replace(DATA, data)


def write(
    trajectory: Trajectory,
    position: Path,
    frames: Sequence[int],
    progress: Callable[[Sequence[int]], Iterable[int]] = iter,
) -> None:
    """Write the page with these frames inside; InputError as `page`, or if the file cannot be written."""
    write_text(position, page(trajectory, frames, progress))


class view:
    """The viewer's page in a notebook, with frames of a trajectory inside: it needs neither server nor network.

    Parameters
    ----------
    trajectory : Trajectory or path
    frames : sequence of int, optional
        Which frames; by default as many as make up some 10 MB, evenly, a hundred at most.
    height : int
        Pixels.

    Raises
    ------
    InputError
        If there is no frame, or no such frame, the file holds no positions, or `frames` and `height` are not as above.

    Examples
    --------
    >>> import ifrdem
    >>> ifrdem.view("cooling.h5")  # doctest: +SKIP
    """

    @validated
    def __init__(
        self, trajectory: Trajectory | str | Path, frames: Sequence[int] | None = None, *, height: int = 640
    ) -> None:
        opened = trajectory if isinstance(trajectory, Trajectory) else Trajectory(trajectory)
        if frames is None:
            most = int(np.clip(NOTEBOOK_DISKS // max(opened.disks.n, 1), 1, NOTEBOOK_FRAMES))
            every = np.linspace(0, len(opened) - 1, min(most, len(opened)))
            frames = np.unique(every.astype(int)).tolist()
        numbers = [
            checked.integer(f"frames[{i}]", one, -MOST_FRAMES, MOST_FRAMES) for i, one in enumerate(frames)
        ]
        if not numbers:
            raise InputError(f"frames = []: must be one or more of the {len(opened)} frames of {opened.path}")
        self._height = checked.integer("height", height, 1, MOST_HEIGHT)
        self._page = page(opened, [opened[i].index for i in numbers])

    def _repr_html_(self) -> str:
        """A separate frame, in which scripts run apart from the notebook."""
        return (
            f'<iframe sandbox="allow-scripts" srcdoc="{html.escape(self._page)}" '
            f'style="width: 100%; height: {self._height}px; border: 0"></iframe>'
        )


def _script(value: Any) -> str:
    return json.dumps(value, allow_nan=False).replace("<", "\\u003c")


def _differences(
    arrays: dict[str, NDArray[Any]], before: dict[str, NDArray[Any]], disks: int
) -> dict[str, NDArray[np.uint8]]:
    """Differences from the frame before, of those arrays that are smaller so when they are deflated.

    Those of the disks, modulo the range of the type, then images as they are; low bytes stand before high ones.
    """
    found = {}
    for name in [each for each in arrays if each in before and each not in ("id", "map")]:
        one = arrays[name].copy()
        common = 2 * disks if name == "position" else disks
        one[:common] -= before[name][:common]
        split = np.concatenate([(one >> 8 * byte).astype(np.uint8) for byte in range(one.itemsize)])
        if len(zlib.compress(split.tobytes(), 1)) < len(zlib.compress(arrays[name].tobytes(), 1)):
            found[name] = split
    return found


def _deflated(data: bytes) -> str:
    return base64.b64encode(zlib.compress(data, 6)).decode()
