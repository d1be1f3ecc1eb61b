"""Shapes of pieces of walls, in one table: the nearest point, the gap to a disk, the bounding box.

The *gap* f(t) between a disk and a wall is positive while they are apart. `root.py` needs f, its slope f', a lower
bound c of f'' until the horizon, and how exact f and f' are.

A piece at rest, or seen from the frame that moves and turns with it, sees a disk's centre at p with |d2p/dt2| <= B
(`motion.py`). Distances to a segment or a point, and from a circle outside of it, are convex functions of p with slopes
of at most 1, so that f'' >= -B; for the inside of a circle (rho^2 - p^2)'' = -2 (|p'|^2 + p . p'') >= -2 (|p'|^2 + B
rho). All are met by the same steps. Bounds reach to the end of the window, not to the earliest meeting known: that
depends on the order in which walls are compared, and steps, whose last bits depend on their bounds, would too.

Arcs. A disk of radius R touches the inside of an arc of radius A from within the circle rho = A - R, the outside from
beyond rho = A + R, at an angle of the arc; it touches the ends as posts of radius 0. A centre that crosses the circle
outside the angles of the arc is followed on its other side until it comes back. Between the two circles it cannot get
behind the arc: there, at the first angle of the arc, it would be nearer than R to its end. The angles of the arc are
widened by 6e-8: at the seam circle and end touch each other, and a circle that is taken so far is
R (6e-8)^2 / 2 = 2e-15 R off.

A shape is a line of `SHAPES`. The functions in it, of wall w and a position (x, y) as a wall that has not turned sees
it, are

`nearest(w, x, y, s, gas)`
    from the nearest point of the wall, displaced by s, to (x, y): unit vector and distance.
`gap(w, relative, nx, ny, distance, radius, behind, gas)`
    of a disk that `root.relative_motion` describes, by what `nearest` gives: the struct of `gap_as`. All pieces from
    which the distance is a convex function of p share `gap_of_convex`.
`box(x, y, qx, qy)`
    bounding box of a piece at (x, y) with the vector (qx, qy), but for its radius: lowest and highest x and y.
"""

from dataclasses import dataclass
from typing import Any

from ..compiler.language import ti
from ..layout import FAR
from .kinds import ARC_INSIDE, FREE, PIECES
from .motion import TWO_PI, epsilon
from .pistons import piston_motion

UNKNOWN = -1  # whether a disk begins behind an arc

# ---------------------------------------------------------------------- nearest points


@ti.func
def from_origin(w, x, y, s, gas: ti.template()):
    """Vector to (x, y) from the point that wall w, displaced by s, is given by."""
    wall = gas.walls[w]
    return x - wall.x - wall.motion.x * s, y - wall.y - wall.motion.y * s


@ti.func
def nearest_of_line(w, x, y, s, gas: ti.template()):
    wall = gas.walls[w]
    dx, dy = from_origin(w, x, y, s, gas)
    qx, qy = wall.towards_x, wall.towards_y
    return qx, qy, dx * qx + dy * qy


@ti.func
def nearest_of_segment(w, x, y, s, gas: ti.template()):
    wall = gas.walls[w]
    dx, dy = from_origin(w, x, y, s, gas)
    qx, qy = wall.towards_x, wall.towards_y
    along = ti.min(ti.max((dx * qx + dy * qy) / (qx * qx + qy * qy), 0.0), 1.0)
    dx -= along * qx
    dy -= along * qy
    r = ti.sqrt(dx * dx + dy * dy)
    return dx / r, dy / r, r - wall.radius


@ti.func
def nearest_of_circle(w, x, y, s, gas: ti.template()):
    """Vector and distance from the nearest point of the outside of a circle."""
    dx, dy = from_origin(w, x, y, s, gas)
    r = ti.sqrt(dx * dx + dy * dy)
    return dx / r, dy / r, r - gas.walls[w].radius


@ti.func
def nearest_inside_circle(w, x, y, s, gas: ti.template()):
    """Vector and distance from the nearest point of the inside of a circle: the vector points inwards."""
    dx, dy = from_origin(w, x, y, s, gas)
    r = ti.sqrt(dx * dx + dy * dy)
    nx, ny = -(dx / r), -(dy / r)
    if r == 0.0:  # in the middle all directions are the same
        nx, ny = 1.0 + 0.0 * x, 0.0 * x
    return nx, ny, gas.walls[w].radius - r


# ---------------------------------------------------------------------- gaps


@ti.func
def gap_as(f, slope, curve, tolerance, noise, here, behind):
    """A gap f, its slope, a lower bound of its curvature until the horizon, and errors of f and of the slope by
    rounding; 0 for `here` where nothing is to be touched, 1 for `behind` on the side of an arc's circle from which its
    face is not touched."""
    return ti.Struct(
        f=f, slope=slope, curve=curve, tolerance=tolerance, noise=noise, here=here, behind=behind
    )


@ti.func
def tolerance_of(w, relative: ti.template(), radius, gas: ti.template()):
    """Error of a gap by rounding: positions are sums of numbers as large as these."""
    size = ti.abs(relative.x) + ti.abs(relative.y) + radius + gas.walls[w].radius
    return 8.0 * ti.static(epsilon()) * size


@ti.func
def largest_speed_of(relative: ti.template(), gas: ti.template()):
    """The largest speed of a disk relative to a wall in the window, while the wall's motion holds."""
    left = ti.min(gas.scale.window, relative.until) - relative.t
    return ti.sqrt(relative.vx * relative.vx + relative.vy * relative.vy) + relative.push * left


@ti.func
def gap_of_line(w, relative: ti.template(), nx, ny, distance, radius, behind, gas: ti.template()):
    """Gap to a line: its curvature is that by gravity, exactly, and by the wall's motion."""
    wall = gas.walls[w]
    gx, gy, ux, uy = gas.scale.gx, gas.scale.gy, wall.motion.x, wall.motion.y
    curve = gx * nx + gy * ny - ti.abs(ux * nx + uy * ny) * relative.bound
    if ti.static(gas.uses.pistons):
        if wall.motion.kind == FREE and wall.piston.rate == 0.0:
            _s, _speed, _bound, pull = piston_motion(w, relative.t, gas)
            curve = gx * nx + gy * ny - (ux * nx + uy * ny) * pull
    slope = nx * relative.vx + ny * relative.vy
    return gap_as(
        distance - radius, slope, curve, tolerance_of(w, relative, radius, gas), relative.noise, 1, behind
    )


@ti.func
def gap_of_convex(w, relative: ti.template(), nx, ny, distance, radius, behind, gas: ti.template()):
    """Gap to a piece from which the distance is a convex function of the position."""
    slope = nx * relative.vx + ny * relative.vy
    return gap_as(
        distance - radius,
        slope,
        -relative.push,
        tolerance_of(w, relative, radius, gas),
        relative.noise,
        1,
        behind,
    )


@ti.func
def gap_of_container(w, relative: ti.template(), nx, ny, distance, radius, behind, gas: ti.template()):
    """(R_c - R)^2 - r^2, with the roots of R_c - R - r: its second derivative is bounded, -2 v^2 without forces."""
    inner = gas.walls[w].radius - radius
    r = gas.walls[w].radius - distance
    most = largest_speed_of(relative, gas)
    slope = (nx * relative.vx + ny * relative.vy) * (2.0 * r)
    curve = -2.0 * (most * most + relative.push * inner)
    tolerance = tolerance_of(w, relative, radius, gas) * (2.0 * inner)
    return gap_as(inner * inner - r * r, slope, curve, tolerance, relative.noise * (2.0 * inner), 1, behind)


# ---------------------------------------------------------------------- arcs, of whose circle only a part is there


def seam() -> float:
    """Angle by which an arc is widened at both ends."""
    return float(4.0 * epsilon() ** 0.5)


@ti.func
def sign_of_arc(w, gas: ti.template()):
    """-1 for the inside of an arc, 1 for the outside."""
    return 1.0 - 2.0 * ti.cast(ti.cast(gas.walls[w].kind, ti.i32) == ARC_INSIDE, ti.i32)


@ti.func
def gap_of_arc(w, relative: ti.template(), nx, ny, distance, radius, behind, gas: ti.template()):
    """rho^2 - r^2 within the circle of centres that touch it, as for a container; r - rho beyond."""
    wall, sign = gas.walls[w], sign_of_arc(w, gas)
    rho = wall.radius + sign * radius
    r = wall.radius + sign * distance
    beyond = r - rho
    tolerance, noise = tolerance_of(w, relative, radius, gas), relative.noise
    is_behind = behind
    if is_behind == UNKNOWN:
        is_behind = ti.cast(-sign * beyond > tolerance, ti.i32)
    out_x, out_y = sign * nx, sign * ny
    middle = out_x * wall.towards_x + out_y * wall.towards_y
    half = wall.half + ti.static(seam())
    here = ti.cast(half >= 0.5 * TWO_PI or middle >= ti.cos(half), ti.i32) * (1 - is_behind)
    f, slope, curve = beyond, out_x * relative.vx + out_y * relative.vy, -relative.push
    if ti.cast(sign < 0.0, ti.i32) ^ is_behind == 1:  # within that circle
        most = largest_speed_of(relative, gas)
        f = -beyond * (r + rho)
        slope *= -2.0 * r
        curve = -2.0 * (most * most + relative.push * rho)
        tolerance *= 2.0 * rho
        noise *= 2.0 * rho
    if rho <= 0.0:  # too narrow for the disk
        f, slope, curve, here = FAR + 0.0 * f, 0.0 * f, 0.0 * f, 0
    return gap_as(f, slope, curve, tolerance, noise, here, is_behind)


@ti.func
def arc_distance(w, nx, ny, distance, gas: ti.template()):
    """Distance from an arc, from the unit vector and the distance that `nearest` gives of its circle."""
    wall, sign = gas.walls[w], sign_of_arc(w, gas)
    radius, half = wall.radius, wall.half
    r = radius + sign * distance
    qx, qy = wall.towards_x, wall.towards_y
    along, across = sign * (nx * qx + ny * qy), sign * (ny * qx - nx * qy)
    found = ti.abs(distance)
    if along < ti.cos(half):  # the end on its side of the middle is nearest
        found = ti.sqrt(
            (r * along - radius * ti.cos(half)) ** 2 + (r * ti.abs(across) - radius * ti.sin(half)) ** 2
        )
    return found


@ti.func
def arc_side_is_not_nearest(w, nx, ny, distance, gas: ti.template()):
    """True where this side of an arc is not what is nearest of it: arguments as above."""
    wall = gas.walls[w]
    along = nx * wall.towards_x + ny * wall.towards_y
    return distance < 0.0 or sign_of_arc(w, gas) * along < ti.cos(wall.half)


# ---------------------------------------------------------------------- bounding boxes


@ti.func
def box_of_line(x, y, qx, qy):
    """Bounding box of a line: without an end along an axis that it is parallel to."""
    low_x, high_x, low_y, high_y = x, x, y, y
    if qx != 0.0:
        low_y, high_y = -FAR + 0.0 * x, FAR + 0.0 * x
    if qy != 0.0:
        low_x, high_x = -FAR + 0.0 * x, FAR + 0.0 * x
    return low_x, high_x, low_y, high_y


@ti.func
def box_of_segment(x, y, qx, qy):
    return ti.min(x, x + qx), ti.max(x, x + qx), ti.min(y, y + qy), ti.max(y, y + qy)


@ti.func
def box_of_point(x, y, qx, qy):
    return x, x, y, y


# ---------------------------------------------------------------------- the table


@dataclass(frozen=True, eq=False)
class ShapeFunctions:
    """Functions of a shape in kernels, by its name in `kinds.PIECES`; the functions are described above."""

    name: str
    nearest: Any
    gap: Any
    box: Any
    bend: int = 0  # 1 of a circle that disks are outside of, -1 inside, 0 of what is flat
    repeats: bool = True  # across periodic sides
    distance: Any = None  # of an arc
    side_is_not_nearest: Any = None

    @property
    def kind(self) -> int:
        """The number that rows of walls hold."""
        return PIECES.index(self.name)


SHAPES = (
    ShapeFunctions("line", nearest_of_line, gap_of_line, box_of_line, repeats=False),
    ShapeFunctions("segment", nearest_of_segment, gap_of_convex, box_of_segment),
    ShapeFunctions("container", nearest_inside_circle, gap_of_container, box_of_point, -1, repeats=False),
    ShapeFunctions("post", nearest_of_circle, gap_of_convex, box_of_point, 1),
    ShapeFunctions(
        "arc inside",
        nearest_inside_circle,
        gap_of_arc,
        box_of_point,
        -1,
        True,
        arc_distance,
        arc_side_is_not_nearest,
    ),
    ShapeFunctions(
        "arc outside",
        nearest_of_circle,
        gap_of_arc,
        box_of_point,
        1,
        True,
        arc_distance,
        arc_side_is_not_nearest,
    ),
)


def shapes_of(uses: Any) -> tuple[ShapeFunctions, ...]:
    """Shapes that a gas with these features may have."""
    return tuple(shape for shape in SHAPES if uses.arcs or shape.distance is None)


def arcs_of(uses: Any) -> tuple[ShapeFunctions, ...]:
    """Shapes of `shapes_of` that are a part of a circle only."""
    return tuple(shape for shape in shapes_of(uses) if shape.distance is not None)


@ti.func
def wall_vector(w, x, y, s, gas: ti.template()):
    """From the point of wall w that is nearest to (x, y), the wall displaced by s, to (x, y): unit vector, distance.

    For a container and the inside of an arc, the vector points inwards, and an arc counts as the whole circle.
    """
    kind = ti.cast(gas.walls[w].kind, ti.i32)
    nx, ny, distance = 0.0 * x, 0.0 * x, 0.0 * x
    for shape in ti.static(shapes_of(gas.uses)):
        if kind == shape.kind:
            nx, ny, distance = shape.nearest(w, x, y, s, gas)
    return nx, ny, distance


@ti.func
def reduced_radius_at(w, radius, gas: ti.template()):
    """Radius of Hertz's contact of a disk and wall w: R of what is flat, R r / (r + R) outside a circle, R r / (r - R)
    inside; K. L. Johnson, Contact Mechanics (1985), chapter 4. Edges, which have no radius, count as flat."""
    wall = gas.walls[w]
    kind = ti.cast(wall.kind, ti.i32)
    found = radius
    for shape in ti.static(shapes_of(gas.uses)):
        if ti.static(shape.bend != 0):
            if kind == shape.kind and wall.radius > 0.0:
                # A disk that fills its container is far from a contact of Hertz, but has a number.
                found = radius * (wall.radius / ti.max(wall.radius + shape.bend * radius, 1e-6 * wall.radius))
    return found


@ti.func
def gap_of(w, relative: ti.template(), radius, behind, gas: ti.template()):
    """The gap between wall w and a disk that `root.relative_motion` describes; `behind` is that of the step before."""
    kind = ti.cast(gas.walls[w].kind, ti.i32)
    zero = 0.0 * relative.x
    found = gap_as(zero, zero, zero, zero, zero, 0, behind)
    for shape in ti.static(shapes_of(gas.uses)):
        if kind == shape.kind:
            nx, ny, distance = shape.nearest(w, relative.x, relative.y, relative.s, gas)
            found = shape.gap(w, relative, nx, ny, distance, radius, behind, gas)
    return found


@ti.func
def wall_box(w, x, y, qx, qy, gas: ti.template()):
    """Lowest and highest x and y of wall w, but for its radius, at (x, y) with the vector (qx, qy)."""
    kind = ti.cast(gas.walls[w].kind, ti.i32)
    low_x, high_x, low_y, high_y = x, x, y, y
    for shape in ti.static(shapes_of(gas.uses)):
        if kind == shape.kind:
            low_x, high_x, low_y, high_y = shape.box(x, y, qx, qy)
    return low_x, high_x, low_y, high_y


@ti.func
def face_distance(w, nx, ny, distance, gas: ti.template()):
    """Distance from wall w where of an arc only its angles count; arguments as `wall_vector` gives them."""
    kind = ti.cast(gas.walls[w].kind, ti.i32)
    found = distance
    for shape in ti.static(arcs_of(gas.uses)):
        if kind == shape.kind:
            found = shape.distance(w, nx, ny, distance, gas)
    return found


@ti.func
def side_is_not_nearest(w, nx, ny, distance, gas: ti.template()):
    """1 where something else than the side of an arc that is wall w is nearest: the other side, or an end."""
    kind = ti.cast(gas.walls[w].kind, ti.i32)
    found = 0
    for shape in ti.static(arcs_of(gas.uses)):
        if kind == shape.kind:
            found = ti.cast(shape.side_is_not_nearest(w, nx, ny, distance, gas), ti.i32)
    return found


@ti.func
def repeats(w, gas: ti.template()):
    """1 if a disk may meet wall w across periodic sides, by an image, else 0."""
    kind = ti.cast(gas.walls[w].kind, ti.i32)
    found = 1
    for shape in ti.static(SHAPES):
        if ti.static(not shape.repeats):
            if kind == shape.kind:
                found = 0
    return found
