"""Names of pictures of a trajectory, and types of options of figures. `ifrdem --help` has them, so this imports names alone."""

from ..analysis.names import ANALYSES

Ends = tuple[float | None, float | None] | None
"""Ends of an axis, None for one that stays; None for both."""

PICTURES = {
    "temperatures": "both temperatures and their ratio against time, with kinetic theory where it holds",
    "disks": "the disks of a frame, coloured by spin, or a map of density if there are many",
    "energy": "translational, rotational and potential energy against time",
    "ledger": "present, dissipated and put-in energy against time, and their residual",
    "mechanisms": "energy dissipated by each mechanism",
    "walls": "force, torque, work and heat of each wall or group against time (output.wall_sums)",
    "piston": "displacement and velocity of each piston against time",
    "dissipation": "a map of the energy that collisions take, and its mechanisms (field dissipated)",
    **{name: each.picture for name, each in ANALYSES.items() if each.picture},
}
"""Name -> what is drawn."""
