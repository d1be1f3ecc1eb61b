"""Validation of many disks: gases against the literature and kinetic theory."""
