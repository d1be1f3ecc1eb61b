"""Tabulated laws: impulses by points of a file, with straight lines between them (`model/laws/table.py`)."""

from ..columns import BISECTIONS, POINTS
from ..compiler.language import ti

OF_SLIP = 2
"""Column of a row, behind two coefficients, at which the slip ratios of the points of P_t / P_n begin; VALUES and SLOPES
columns later those of the lines that begin there: their values at 0, and their slopes."""
VALUES, SLOPES = POINTS, 2 * POINTS
OF_SPEED = OF_SLIP + 3 * POINTS
"""Column at which those of e_n begin: speeds, values, slopes."""


@ti.pyfunc
def line_at(above, below, first, row):
    """Number of the line of a table of `row` for above / below: that from its last point which is not beyond it."""
    i = 0
    for n in ti.static(range(BISECTIONS)):
        half = ti.static(POINTS >> (n + 1))
        i = i + half * (1 * (above >= row[first + i + half] * below))
    return first + i


@ti.pyfunc
def table_parts(pair, law, row):
    """A tabulated law, as `law.ifr_parts`: an impact sticks, and has restitution only, below the transition."""
    slip = ti.abs(pair.g_t)
    i = line_at(pair.g_n, 1.0, OF_SPEED, row)
    e_n = row[i + VALUES] + row[i + SLOPES] * pair.g_n
    j = line_at(slip, pair.g_n, OF_SLIP, row)
    both = (1.0 + e_n) * pair.m_n
    P_n = both * pair.g_n
    direction = 1.0 * (pair.g_t > 0.0) - 1.0 * (pair.g_t < 0.0)
    # P_n times the ratio, values + slopes slip / g_n.
    P_t = direction * both * (row[j + VALUES] * pair.g_n + row[j + SLOPES] * slip)
    sticking = 1.0 * (slip < law.transition * pair.g_n)
    return P_n, P_t, 0.0 * P_n, sticking * P_t, sticking, 0.0 * P_n


@ti.pyfunc
def table(pair, law, row):
    """A tabulated law without a ledger: P_n, P_t, T of `table_parts`."""
    P_n, P_t, T, _, _, _ = table_parts(pair, law, row)
    return P_n, P_t, T
