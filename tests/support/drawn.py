"""Cases and damaged files drawn by Hypothesis, which shrinks what fails to its smallest form."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from hypothesis import settings
from hypothesis import strategies as st

from ifrdem.validation.gas import cases

FULL = 5
"""Times as many examples with `--full`."""

CHANCES = [
    1.0 - (i + 0.5) / 200.0 for i in range(200)
]  # what is seldom is below its part: the simplest is not
STEPS = sorted((i / 100.0 for i in range(-100, 101)), key=abs)  # from the middle of a range, in halves of it
ENDS = sorted((i / 10.0 for i in range(-30, 31)), key=abs)


def examples(number: int) -> settings:
    """So many examples of a test, and `FULL` times as many with `--full`."""
    return settings(max_examples=number * (FULL if settings.get_current_profile_name() == "full" else 1))


class Dice:
    """Dice with the methods of `random.Random`, drawn by Hypothesis: the first of several is the simplest.

    Of lists and not of ranges, whose ends Hypothesis prefers: those of a generator are numbers 30 decades off. Not by
    `st.randoms`, whose simplest number is 0: what is seldom would always be, and cases would grow as they shrink.
    """

    def __init__(self, draw: Callable[[st.SearchStrategy[Any]], Any]) -> None:
        self.draw = draw

    def choice(self, values: Sequence[Any]) -> Any:
        return self.draw(st.sampled_from(values))

    def sample(self, values: Sequence[Any], k: int) -> list[Any]:
        return [values[i] for i in self.draw(st.permutations(range(len(values))))[:k]]

    def random(self) -> float:
        return self.choice(CHANCES)

    def uniform(self, low: float, high: float) -> float:
        middle = 0.5 * (low + high)
        return middle + (high - middle) * self.choice(STEPS)

    def gauss(self, mean: float, deviation: float) -> float:
        return mean + deviation * self.choice(ENDS)

    def randrange(self, end: int) -> int:
        return self.choice(range(end))

    def randint(self, first: int, last: int) -> int:
        return self.choice(sorted(range(first, last + 1), key=abs))

    def randbytes(self, n: int) -> bytes:
        return self.draw(st.binary(min_size=n, max_size=n))


@st.composite
def random_cases(draw: Any, kinds: Sequence[str] = cases.KINDS) -> tuple[dict[str, Any], str | None]:
    """Cases of these sets of features, with the start file that each may name."""
    return cases.random_case(Dice(draw), draw(st.sampled_from(kinds)))  # type: ignore[arg-type]


class Whole(bytes):
    """The bytes of a whole file; the report of a failure does not list them."""

    def __repr__(self) -> str:
        return f"<{len(self)} bytes>"


class Damage(NamedTuple):
    """Change of the bytes of a file: from `at` on, `size` bytes become `new`."""

    at: int
    size: int
    new: bytes

    def done(self, content: bytes) -> bytes:
        return content[: self.at] + self.new + content[self.at + self.size :]


@st.composite
def flips(draw: Any, content: bytes) -> Damage:
    """A bit of a file, where it is not empty anyway."""
    at = draw(st.sampled_from([i for i, byte in enumerate(content) if byte]))
    return Damage(at, 1, bytes([content[at] ^ 1 << draw(st.sampled_from(range(8)))]))


@st.composite
def losses(draw: Any, content: bytes) -> Damage:
    """A file that ends early, has zeros or noise in a place that is not empty, or more at its end."""
    kind = draw(st.sampled_from(("cut", "zeros", "noise", "more")))
    if kind == "more":
        return Damage(
            len(content), 0, draw(st.binary(min_size=1, max_size=64)) * draw(st.sampled_from((1, 64)))
        )
    at = draw(st.sampled_from([i for i, byte in enumerate(content) if byte]))
    if kind == "cut":
        return Damage(at, len(content), b"")
    size = min(draw(st.sampled_from((8, 64, 512))), len(content) - at)
    return Damage(at, size, bytes(size) if kind == "zeros" else draw(st.binary(min_size=size, max_size=size)))


def damages(content: bytes) -> st.SearchStrategy[list[Damage]]:
    """One or three flipped bits, or a loss."""
    bits = flips(content)
    return st.one_of(st.lists(bits, min_size=1, max_size=1), st.lists(bits, min_size=3, max_size=3),
                     st.lists(losses(content), min_size=1, max_size=1))  # fmt: skip


def damaged(content: bytes, damage: Sequence[Damage]) -> bytes:
    """The bytes of a file after all of this."""
    for each in damage:
        content = each.done(content)
    return content
