"""Ranks of MPI: a communicator, and which rows and tiles each rank has."""
