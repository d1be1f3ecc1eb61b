"""Last lines of a run in which disks come to rest."""

from __future__ import annotations

from pathlib import Path

import pytest

from ifrdem.cli.main import main

CASE = """
[run]
name = "drop"
t_end = 12.0
units = "reduced"
{remedy}

[box]
lengths = [6.0, 4.0]
periodic = [true, false]
material = "stone"
gravity = [0.0, -1.0]

[[material]]
name = "stone"
e_n = 0.4
e_t = -1.0
mu = 0.5

[[species]]
name = "stones"
number = 4
material = "stone"
mass = 1.0
diameter = 1.0
speed_rms = 0.1

[output]
picture = false
"""


@pytest.mark.full
@pytest.mark.parametrize(
    ("remedy", "says", "never"),
    [
        (
            'collapse = "rest"\nresting_speed = 0.05',
            "collisions were slower than the resting speed, 0.05",
            "the remedy for inelastic collapse",
        ),
        (
            'collapse = "contact_time"\ncontact_time = 0.01',
            "collisions were made elastic by the remedy for inelastic collapse",
            "resting speed",
        ),
    ],
)
def test_slow_collisions_of_resting_disks_are_not_reported_as_a_remedy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], remedy: str, says: str, never: str
) -> None:
    (tmp_path / "drop.toml").write_text(CASE.format(remedy=remedy))
    assert main(["run", str(tmp_path / "drop.toml"), "-o", f"{tmp_path}/"]) == 0
    printed = capsys.readouterr().out
    assert says in printed
    assert never not in printed
