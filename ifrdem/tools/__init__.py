"""Helpers that know no physics: seeds, CSV rows, short reprs, versions."""
