"""Histograms of the collisions of two disks, counted as they happen: no collision is written down.

Bins have edges that every machine computes alike, without a logarithm or an arc tangent: those of the impact angle are
even in g_t / (g_n + g_t), of the relative velocity of the centres; those of speeds and times divide each power of 2
into equal parts, which are the exponent and the first bits of a double. What is beyond the first or last bin is counted
there.
"""

from ..columns import (
    FIRST_OCTAVE,
    HISTOGRAM,
    OCTAVES,
    PER_OCTAVE,
    TALLY,
    histogram_columns,
    transfer_columns,
)
from ..compiler.language import ti
from ..layout import ELASTICALLY, FAR
from .particle import add

ANGLES = HISTOGRAM.impact_angle.width
SHIFT = 52 - (
    PER_OCTAVE.bit_length() - 1
)  # of the bits of a double, to exponent and first bits of the fraction
FIRST = (1023 + FIRST_OCTAVE) * PER_OCTAVE


@ti.func
def octave_bin(value):
    """Number of the bin of a speed or time, which is not negative."""
    bits = ti.bit_cast(ti.cast(value, ti.f64), ti.i64)
    number = ti.cast(bits >> SHIFT, ti.i32) - FIRST
    return ti.max(0, ti.min(number, OCTAVES * PER_OCTAVE - 1))


@ti.func
def species_of(id_of_disk, gas: ti.template()):
    """Number of the species of a disk, by its id."""
    species = 0
    for j in ti.static(range(1, gas.uses.histograms)):
        if id_of_disk >= gas.first_of_species[j]:
            species = j
    return species


@ti.func
def enter_histograms(tile, id_a, id_b, g_n, g_t, free_a, free_b, regime, gas: ti.template()):
    """Count a collision of disks a and b in the histograms of the pair of their species.

    g_n, g_t: normal and tangential part of the relative velocity of the centres; free times of disks that have not
    collided before are infinite, and not counted.
    """
    p, q = species_of(id_a, gas), species_of(id_b, gas)
    high, low = ti.max(p, q), ti.min(p, q)
    pair = high * (high + 1) // 2 + low
    first = ti.static(TALLY.width + transfer_columns(gas.uses.stress, gas.uses.heat_flux)) + pair * ti.static(
        histogram_columns(gas.uses.histograms, gas.uses.free_times)
    )
    closing = ti.max(g_n, 0.0)  # rounding can make it negative
    angle = 0
    if g_t > 0.0:
        angle = ti.min(ti.cast(g_t / (closing + g_t) * ANGLES, ti.i32), ANGLES - 1)
    add(tile, first + HISTOGRAM.impact_angle[angle], 1.0, gas)
    add(tile, first + HISTOGRAM.normal_speed[octave_bin(closing)], 1.0, gas)
    add(tile, first + HISTOGRAM.regime[ti.min(regime, ELASTICALLY)], 1.0, gas)
    if ti.static(gas.uses.free_times):
        if free_a < FAR:
            add(tile, first + HISTOGRAM.free_time[octave_bin(free_a)], 1.0, gas)
        if free_b < FAR:
            add(tile, first + HISTOGRAM.free_time[octave_bin(free_b)], 1.0, gas)
