"""Hard disks in a periodic box: the events of a window in rounds, as in `kernels/windows/blocks.py`, and one by one.

In plain Python, of a pair at a time, with formulas of its own: smooth elastic disks of mass and diameter 1. Only the
rule, the certificate and its proof are those of the kernel.
"""

from __future__ import annotations

import heapq
import math
from copy import deepcopy
from dataclasses import dataclass, field

import numpy as np

NEVER = math.inf
FASTER = 1.5  # than at the beginning of a window disks may be for the lists
MEAN_SPEED = math.sqrt(math.pi / 2.0)  # at temperature 1


@dataclass
class Disk:
    """Where the flight of a disk began, its next event, and its largest speed in the window."""

    x: float
    y: float
    vx: float
    vy: float
    since: float = 0.0
    time: float = NEVER
    partner: int = -1
    partner_number: int = 0
    number: int = 0
    """Collisions in the window; an event is stale if that of the partner has changed since."""
    met: int = -1
    top: float = 0.0


@dataclass
class Marks:
    """How often the order was not certain in a window, and how many disks were too fast for the lists."""

    collisions: int = 0
    """After a collision."""
    stale: int = 0
    """Where a stale event was predicted again."""
    fast: int = 0

    def any(self, *, stale: bool = True) -> bool:
        """True if there is a mark; those at stale events count unless told otherwise."""
        return self.collisions > 0 or self.fast > 0 or (stale and self.stale > 0)


@dataclass
class Gas:
    """Disks in a periodic square box, the length of a window, and for each disk those that it can meet in one."""

    side: float
    window: float
    disks: list[Disk]
    near: list[list[int]] = field(default_factory=list)
    fastest: float = 0.0
    """Speed that the lists are made for."""

    def image(self, distance: float) -> float:
        """The shortest of the distances along an axis between images of two disks."""
        return distance - self.side * round(distance / self.side)

    def begin(self) -> None:
        """Begin a window: fly to its end, list the disks near each, and predict the first events."""
        for disk in self.disks:
            ahead = self.window - disk.since if disk.number or self.near else 0.0
            disk.x, disk.y = disk.x + disk.vx * ahead, disk.y + disk.vy * ahead
            disk.since, disk.number, disk.met = 0.0, 0, -1
            disk.top = math.hypot(disk.vx, disk.vy)
        position = np.array([(disk.x, disk.y) for disk in self.disks])
        apart = position[:, None] - position
        apart -= self.side * np.rint(apart / self.side)
        self.fastest = FASTER * max(disk.top for disk in self.disks)
        reach = 1.0 + 2.0 * self.window * self.fastest
        close = np.hypot(apart[..., 0], apart[..., 1]) < reach
        np.fill_diagonal(close, False)
        self.near = [np.flatnonzero(row).tolist() for row in close]
        for i in range(len(self.disks)):
            self.predict(i)

    def meeting(self, i: int, k: int) -> float:
        """Time of the meeting of two disks on their present flights."""
        a, b = self.disks[i], self.disks[k]
        start = max(a.since, b.since)
        rx = self.image(b.x - a.x) + b.vx * (start - b.since) - a.vx * (start - a.since)
        ry = self.image(b.y - a.y) + b.vy * (start - b.since) - a.vy * (start - a.since)
        ux, uy = b.vx - a.vx, b.vy - a.vy
        approach, gap = rx * ux + ry * uy, rx * rx + ry * ry - 1.0
        if approach >= 0.0 or (a.met == k and b.met == i and gap < 0.25):
            return NEVER
        if gap <= 0.0:
            return start
        square = approach * approach - (ux * ux + uy * uy) * gap
        return start + gap / (math.sqrt(square) - approach) if square > 0.0 else NEVER

    def predict(self, i: int) -> None:
        """Store the next event of a disk within the window, with the smaller partner of two at the same time."""
        disk = self.disks[i]
        times = [(self.meeting(i, k), k) for k in self.near[i]]
        disk.time, disk.partner = min(times, default=(NEVER, -1))
        if disk.time >= self.window:
            disk.time, disk.partner = NEVER, -1
        else:
            disk.partner_number = self.disks[disk.partner].number

    def is_stale(self, i: int) -> bool:
        """True if the partner in the event of a disk has collided since the event was predicted."""
        disk = self.disks[i]
        return self.disks[disk.partner].number != disk.partner_number

    def collide(self, i: int, k: int, time: float) -> None:
        """Fly two disks to their collision, and exchange their velocities along the normal."""
        first, second = min(i, k), max(i, k)
        a, b = self.disks[first], self.disks[second]
        for disk in (a, b):
            disk.x, disk.y = disk.x + disk.vx * (time - disk.since), disk.y + disk.vy * (time - disk.since)
            disk.since = time
            disk.number += 1
        rx, ry = self.image(b.x - a.x), self.image(b.y - a.y)
        distance = math.hypot(rx, ry)
        nx, ny = rx / distance, ry / distance
        impulse = max((a.vx - b.vx) * nx + (a.vy - b.vy) * ny, 0.0)
        a.vx, a.vy = a.vx - impulse * nx, a.vy - impulse * ny
        b.vx, b.vy = b.vx + impulse * nx, b.vy + impulse * ny
        a.met, b.met = second, first
        for disk in (a, b):
            disk.top = max(disk.top, math.hypot(disk.vx, disk.vy))

    def is_uncertain(self, i: int, time: float) -> bool:
        """True if a disk that looks around at a time may have met one whose flight began later."""
        disk = self.disks[i]
        x, y = disk.x + disk.vx * (time - disk.since), disk.y + disk.vy * (time - disk.since)
        speed = math.hypot(disk.vx, disk.vy)
        for k in self.near[i]:
            other = self.disks[k]
            ahead = other.since - time
            if ahead > 0.0:
                way = 1.0 + 1.000001 * max(speed, other.top) * ahead
                if self.image(other.x - x) ** 2 + self.image(other.y - y) ** 2 < way * way:
                    return True
        return False

    def run_in_order(self) -> None:
        """The events of a window in the order of their times, from a heap."""
        version = [0] * len(self.disks)
        heap = [(disk.time, i, 0) for i, disk in enumerate(self.disks) if disk.partner >= 0]
        heapq.heapify(heap)
        while heap:
            time, i, made = heapq.heappop(heap)
            if made != version[i]:
                continue
            changed = [i]
            if not self.is_stale(i):
                changed.append(self.disks[i].partner)
                self.collide(*changed, time)
            for k in changed:
                self.predict(k)
                version[k] += 1
                if self.disks[k].partner >= 0:
                    heapq.heappush(heap, (self.disks[k].time, k, version[k]))

    def first_events(self, bare: bool) -> list[int]:
        """Disks whose events come before every other event of both of their disks.

        Also before every one of the disks in the lists of both, unless the rule is `bare`.
        """
        low = [NEVER] * len(self.disks)
        for i, disk in enumerate(self.disks):
            if disk.partner >= 0:
                low[i], low[disk.partner] = min(low[i], disk.time), min(low[disk.partner], disk.time)
        found = []
        for i, disk in enumerate(self.disks):
            k = disk.partner
            if k < 0 or low[i] < disk.time or low[k] < disk.time:
                continue
            other = self.disks[k]
            if other.partner == i and other.time == disk.time and k < i:
                continue  # both have stored it: once
            around = (*self.near[i], *self.near[k])
            if bare or all(low[m] > disk.time for m in around if m not in (i, k)):
                found.append(i)
        return found

    def run_in_rounds(self, *, bare: bool = False) -> Marks:
        """The events of a window in rounds of first events."""
        marks = Marks()
        while any(disk.partner >= 0 for disk in self.disks):
            queue = self.first_events(bare)
            assert queue, "two events of neighbours have the same time"
            for i in queue:
                k, time = self.disks[i].partner, self.disks[i].time
                if self.is_stale(i):
                    marks.stale += self.is_uncertain(i, time)
                    self.predict(i)
                else:
                    self.collide(i, k, time)
                    marks.collisions += self.is_uncertain(i, time) or self.is_uncertain(k, time)
                    self.predict(i)
                    self.predict(k)
        marks.fast = sum(disk.top > self.fastest for disk in self.disks)
        return marks

    def numbers(self) -> np.ndarray:
        """What a window leaves of each disk: position and velocity, beginning of the flight, collisions."""
        return np.array([(d.x, d.y, d.vx, d.vy, d.since, d.number) for d in self.disks])


def gas_of(n: int, packing_fraction: float, collisions: float, seed: int) -> Gas:
    """n disks on a triangular lattice at temperature 1, and windows of so many collisions of a disk on average."""
    side = math.sqrt(n * math.pi / 4.0 / packing_fraction)
    columns = math.ceil(math.sqrt(n * math.sqrt(3.0) / 2.0))
    rows = math.ceil(n / columns)
    velocity = np.random.default_rng(seed).normal(size=(n, 2))
    velocity -= velocity.mean(axis=0)
    disks = [
        Disk(
            (i % columns + 0.5 * (i // columns % 2) + 0.25) * side / columns,
            (i // columns + 0.5) * side / rows,
            float(velocity[i, 0]),
            float(velocity[i, 1]),
        )
        for i in range(n)
    ]
    density = packing_fraction * 4.0 / math.pi
    contact = (1.0 - 7.0 * packing_fraction / 16.0) / (1.0 - packing_fraction) ** 2  # Henderson (1975)
    free_path = 1.0 / (2.0 * math.sqrt(2.0) * density * contact)
    return Gas(side, collisions * free_path / MEAN_SPEED, disks)


@dataclass
class Window:
    """Whether a window in rounds differs from the one in order in any bit, its marks, and its collisions."""

    wrong: bool
    marks: Marks
    collisions: int


def windows_of(gas: Gas, warm_up: int, windows: int, *, bare: bool = False) -> list[Window]:
    """Windows in rounds, each from the state that the windows in order have led to, after some to warm up."""
    found = []
    for number in range(warm_up + windows):
        gas.begin()
        rounds = deepcopy(gas) if number >= warm_up else None
        gas.run_in_order()
        if rounds is not None:
            marks = rounds.run_in_rounds(bare=bare)
            right = gas.numbers()
            wrong = right.tobytes() != rounds.numbers().tobytes()
            found.append(Window(wrong, marks, int(right[:, -1].sum()) // 2))
    return found
