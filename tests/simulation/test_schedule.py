"""When frames and rows of series are due."""

from __future__ import annotations

import json
import math

import pytest

from ifrdem.errors import InputError
from ifrdem.simulation.steps.schedule import RunPlan, RunPoint, Trigger, end_at


class Points:
    """Points of a trigger in a run of some disks, whose ends are those of `end_at`."""

    def __init__(
        self, trigger: Trigger, n: int = 10, *, time: float = 0.0, collisions: int = 0, **end: float
    ) -> None:
        begin = RunPoint(time, collisions)
        self.plan = RunPlan(n, begin, end_at(n, begin, **end), frames=trigger)

    def __call__(self, k: int) -> RunPoint:
        return self.plan.point(self.plan.frames, k)

    def after(self, k: int, time: float, collisions: int) -> int:
        return self.plan.first_not_reached(self.plan.frames, k, time, collisions)


def test_a_number_divides_the_run_evenly_and_ends_with_it():
    times = [Points(Trigger(number=4), t_end=3.0, time=1.0)(k).time for k in range(1, 6)]
    assert times == [1.5, 2.0, 2.5, 3.0, 3.0]


def test_the_last_point_is_the_end_to_the_bit():
    """0.3 + (0.9 - 0.3) is not 0.9 in floating-point numbers: a run would end a rounding error too early or late."""
    begin, end = 0.3, 0.9
    assert begin + (end - begin) != end
    for spacing in ("even", "log"):
        assert Points(Trigger(number=5, spacing=spacing), t_end=end, time=begin)(5).time == end


def test_points_count_from_where_the_run_begins():
    """10 disks that have had 6 collisions, to 4 collisions per disk: 20. And from a time of 1 on."""
    had = {"collisions_per_disk": 4.0, "collisions": 6}
    assert [Points(Trigger(number=7), **had)(k).collisions for k in (1, 2, 7)] == [8, 10, 20]
    assert [Points(Trigger(collisions=0.5), **had)(k).collisions for k in (1, 2, 9)] == [9, 11, 20]
    assert [Points(Trigger(interval=0.5), t_end=3.0, time=1.0)(k).time for k in (1, 2, 9)] == [
        1.5,
        2.0,
        3.0,
    ]
    assert Trigger(interval=0.4).count(duration=1.0, collisions_per_disk=9.0) == 3  # at 0.4, 0.8 and the end
    assert Trigger(collisions=4.0).count(duration=1.0, collisions_per_disk=9.0) == 3
    assert Trigger(number=5).count(duration=1.0, collisions_per_disk=9.0) == 5


@pytest.mark.parametrize("number", [1, 3, 7, 10, 1000])
def test_rounding_makes_no_collision_more_of_a_part(number):
    # 10 disks with 2 * number / 10 collisions each: `number` collisions, one for each frame.
    schedule = Points(Trigger(number=number), collisions_per_disk=number / 5.0)
    assert [schedule(k).collisions for k in range(1, number + 1)] == list(range(1, number + 1))


def test_logarithmic_points_have_one_ratio_and_the_given_first_point():
    schedule = Points(Trigger(number=4, spacing="log", log_from=1e-3), t_end=2.0)
    times = [schedule(k).time for k in range(1, 5)]
    assert times == pytest.approx([2e-3, 2e-2, 2e-1, 2.0], rel=1e-12)


def test_intervals_of_time_end_with_a_run_by_collisions_and_the_reverse():
    by_time = Points(Trigger(interval=0.5), collisions_per_disk=4.0)
    assert by_time(3) == RunPoint(1.5, 20)
    by_collisions = Points(Trigger(collisions=0.5), t_end=2.0)
    assert by_collisions(2) == RunPoint(2.0, 5)
    # 0.5 per disk, 10 disks, two at each collision: 2.5 collisions, which a frame cannot follow sooner than after 3.
    assert by_collisions(1) == RunPoint(2.0, 3)


def test_what_has_been_reached_already_is_not_due_again():
    # 10 collisions, 100 points: ten stand at each.
    schedule = Points(Trigger(number=100), collisions_per_disk=2.0)
    assert schedule.after(1, 0.0, 3) == 31
    interval = Points(Trigger(interval=0.1), t_end=1.0)
    assert interval.after(1, 0.55, 0) == 6
    # At the end nothing more is: no endless search.
    assert interval.after(1, 1.0, 0) <= 10


def test_a_point_far_ahead_is_found_at_once():
    """Among 1e7 points, the most there may be: the first after, by the definition of `point`, and none is left out."""
    many = Points(Trigger(number=10**7), collisions_per_disk=2.0)
    found = many.after(1, 0.0, 7)
    assert many(found - 1).collisions == 7
    assert many(found).collisions == 8
    interval = Points(Trigger(interval=1e-7), t_end=1.0)
    k = interval.after(5, 0.25, 0)
    assert interval(k).time > 0.25
    assert interval(k - 1).time <= 0.25
    # One that is not reached stays, the run's end too.
    assert many.after(3, 0.0, 0) == 3
    assert Points(Trigger(number=4), t_end=1.0).after(2, 0.3, 0) == 2


def test_every_point_is_the_first_that_is_not_reached():
    schedule = Points(Trigger(number=37, spacing="log"), collisions_per_disk=40.0)
    for k in (1, 2, 20, 36):
        for collisions in range(0, 200, 7):
            expected = k
            while schedule(expected).reached(0.0, collisions):
                expected += 1
            assert schedule.after(k, 0.0, collisions) == expected


def test_an_interval_that_a_time_cannot_resolve_is_refused():
    """Floating-point numbers about 1e6 are 1.2e-10 apart."""
    end = 1e6 + 2.0**-11
    with pytest.raises(
        InputError, match=r"interval = 1e-10: lost in the rounding of a time of 1e\+06: must be 1\.16e-10"
    ):
        Points(Trigger(interval=1e-10), time=1e6, t_end=end)
    assert Points(Trigger(interval=2e-10), time=1e6, t_end=end)(1).time > 1e6


def test_the_earlier_of_two_points_is_reached_when_either_is():
    both = RunPoint(2.0).earlier(RunPoint(collisions=7))
    assert both == RunPoint(2.0, 7)
    assert both.reached(2.0, 0)
    assert both.reached(0.0, 7)
    assert not both.reached(1.9, 6)
    assert (
        RunPoint(collisions=9).earlier(RunPoint(3.0, 4))
        == RunPoint(3.0, 4).earlier(RunPoint(collisions=9))
        == RunPoint(3.0, 4)
    )


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({}, "exactly one"),
        ({"number": 3, "interval": 1.0}, "exactly one"),
        ({"number": 0}, "number = 0"),
        ({"interval": 0.0}, "interval = 0"),
        ({"interval": 1e-300}, "interval = 1e-300: must be"),
        ({"collisions": math.nan}, "collisions = nan"),
        ({"number": 3, "spacing": "logarithmic"}, "must be one of even, log"),
        ({"interval": 1.0, "spacing": "log"}, "needs a number"),
        ({"number": 3, "log_from": 1.0}, "log_from = 1"),
    ],
)
def test_impossible_cadences_are_refused(options, reason):
    with pytest.raises(InputError, match=reason):
        Trigger(**options)


def test_points_that_coincide_are_passed_together() -> None:
    # 10 disks, one collision each on average: 5 collisions, between which 1000 points fall onto 5 places.
    schedule = Points(Trigger(number=1000), collisions_per_disk=1.0)
    k, places = 1, []
    while schedule(k) != RunPoint(collisions=5):
        places.append(schedule(k).collisions)
        k = schedule.after(k, 0.0, places[-1])
        assert schedule(k - 1) != schedule(k)
    assert places == [1, 2, 3, 4]
    assert k == 801


def test_collisions_per_disk_are_decimal_fractions() -> None:
    # 0.1 collisions a disk are 10 of 200 disks, although the binary number is a hair above; 1.1 are 110.
    schedule = Points(Trigger(collisions=0.1), n=200, collisions_per_disk=1.1)
    assert [schedule(k).collisions for k in range(1, 13)] == [
        10,
        20,
        30,
        40,
        50,
        60,
        70,
        80,
        90,
        100,
        110,
        110,
    ]


def test_a_plan_that_comes_back_from_its_record_is_the_same() -> None:
    frames, series = Trigger(collisions=0.1), Trigger(number=20, exact=False)
    for end in ({"t_end": 3.0}, {"collisions_per_disk": 1.5}):
        plan = RunPlan(10, RunPoint(0.1, 2), end_at(10, RunPoint(0.1, 2), **end), frames, series, 3, 4)
        record = json.loads(json.dumps(plan.to_record()))
        assert RunPlan.from_record(record, frames, series) == plan
