"""How long each kernel takes, by Taichi's own profiler: a clock around each loop of a kernel, on the device.

Start Taichi with `backend.start(..., profile=True)` first. On a CPU a task begins and ends on the host's clock
(about 1 us fine), so the shares add up to what the host waits for; the rest is Python and launches. On a GPU, events
in its stream are timed, and kernels run one after the other as they do without a profiler.
"""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import dataclass

# settle_c80_0_kernel_11_range_for: kernel, its number, that of the instance, that of the loop, the kind of loop
_TASK = re.compile(r"(?P<instance>(?P<kernel>.+)_c\d+_\d+)_kernel_\d+_\w+")


@dataclass(frozen=True)
class KernelTime:
    """A kernel, how often it was called, and how long all of its calls took [s]."""

    kernel: str
    calls: int
    seconds: float


def forget() -> None:
    """Begin anew: leave out everything before."""
    import taichi as ti

    ti.sync()
    ti.profiler.clear_kernel_profiler_info()


def kernel_times() -> list[KernelTime]:
    """The time of each kernel since `forget`, all loops of a kernel together, the longest first."""
    import taichi as ti

    ti.sync()
    program = ti.lang.impl.get_runtime().prog
    program.update_kernel_profiler()  # brings in what a GPU has measured
    return gathered([(record.name, record.kernel_time) for record in program.get_kernel_profiler_records()])


def gathered(records: list[tuple[str, float]]) -> list[KernelTime]:
    """Times by kernel, from records of tasks: name and milliseconds of each time that one ran."""
    ran: dict[str, int] = defaultdict(int)
    seconds: dict[str, float] = defaultdict(float)
    instances: dict[str, dict[str, int]] = defaultdict(lambda: defaultdict(int))
    for task, _ in records:
        ran[task] += 1
    for task, milliseconds in records:
        found = _TASK.fullmatch(task)
        kernel, instance = (found["kernel"], found["instance"]) if found else (task, task)
        seconds[kernel] += 1e-3 * milliseconds
        # Every call runs each of its tasks once.
        instances[kernel][instance] = max(instances[kernel][instance], ran[task])
    times = [KernelTime(kernel, sum(instances[kernel].values()), seconds[kernel]) for kernel in seconds]
    return sorted(times, key=lambda each: (-each.seconds, each.kernel))
