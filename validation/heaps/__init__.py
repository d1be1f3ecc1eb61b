"""Heaps and drums of resting disks, measured by this program, by LAMMPS and by Chipmunk."""
