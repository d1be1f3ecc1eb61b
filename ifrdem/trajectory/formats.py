"""Formats of other codes that trajectories and tables are exported to. Commands list them, so this imports nothing else."""

from typing import Literal, get_args

OfFrames = Literal["gsd", "extxyz", "csv", "h5"]
OfTables = Literal["csv", "parquet"]
Format = Literal[OfFrames, OfTables]
FORMATS: tuple[str, ...] = get_args(OfFrames)
TABLES: tuple[str, ...] = get_args(OfTables)
"""TABLES: of collisions, and of the runs of a study."""
