"""LAMMPS beside our engine: the library in a process, its contacts, our law inside it, and the cases of its group."""
