"""Counts of what the engine does."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class Statistics:
    """What the engine has done since it was made; `in_order` are the epochs of tiles that were left to one thread."""

    epochs: int = 0
    in_order: int = 0
    rounds: int = 0
    undone: int = 0
    violations: int = 0
    cut_for_speed: int = 0
    cut_for_log: int = 0
    cut_for_rounds: int = 0
    elastic: int = 0
