"""Contact value of hard disks: how much a finite density raises the collision rate."""


def henderson(packing_fraction: float) -> float:
    """Contact value of equal hard disks, (1 - 7 phi / 16) / (1 - phi)^2: D. Henderson, Mol. Phys. 30, 971 (1975)."""
    return (1.0 - 7.0 * packing_fraction / 16.0) / (1.0 - packing_fraction) ** 2
