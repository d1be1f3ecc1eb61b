"""Command lines."""

from __future__ import annotations

import argparse
from typing import NoReturn

from .errors import InputError


class Parser(argparse.ArgumentParser):
    """Raises InputError instead of exiting, so that every message leaves in the same way."""

    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message} (see `{self.prog} --help`)")
