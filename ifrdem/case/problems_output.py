"""What is wrong with what a case keeps, beyond types and ranges."""

from __future__ import annotations

from collections.abc import Iterator

from ..model.box import Box
from .draft import Draft, Problem


def problems_of_output(draft: Draft, n: int, box: Box | None) -> Iterator[Problem]:
    """What is wrong with the output of n disks in a box."""
    output = draft.output
    if output is None:
        return
    twice = [name for i, name in enumerate(output.fields) if name in output.fields[:i]]
    if twice:
        yield Problem("output.fields", f'"{twice[0]}"', "it is there already; each may be given once")
    if output.histories is not None:
        beyond = [each for each in output.histories if each >= n]
        if beyond:
            yield Problem("output.histories", str(beyond[0]), f"there are disks 0 to {n - 1}")
        repeated = [each for i, each in enumerate(output.histories) if each in output.histories[:i]]
        if repeated:
            yield Problem("output.histories", str(repeated[0]), "it is there already")
    if output.histories_sample is not None and output.histories_sample > n:
        yield Problem("output.histories_sample", str(output.histories_sample), f"there are {n} disks")
    region = output.histories_region
    if region is not None:
        x_low, y_low, x_high, y_high = region
        if not (x_low < x_high and y_low < y_high):
            text = "[x_low, y_low, x_high, y_high] is needed, each low one below the high one"
            yield Problem("output.histories_region", str(region), text)
        elif box is not None and not box.is_open:
            length_x, length_y = box.lengths
            if x_low >= length_x or y_low >= length_y or x_high <= 0.0 or y_high <= 0.0:
                text = f"lies outside of the box, {length_x:.5g} x {length_y:.5g}"
                yield Problem("output.histories_region", str(region), text)
    if output.tracks and box is not None and box.shear_rate:
        text = "not supported in a sheared box: leave histories out, or shear between walls that move"
        yield Problem("output.histories", None, text)
