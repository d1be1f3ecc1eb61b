"""Last lines of a run in which disks come to rest."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from support.cases import case_text

from ifrdem.cli.main import main

CASE = case_text({
    "run.name": "drop", "run.t_end": 12.0,
    "box": {"lengths": [6.0, 4.0], "periodic": [True, False], "material": "coin", "gravity": [0.0, -1.0]},
    "material[0].e_n": 0.4, "material[0].e_t": -1.0, "material[0].mu": 0.5,
    "species[0].number": 4, "species[0].speed_rms": 0.1, "output.picture": False,
})  # fmt: skip


@pytest.mark.full
@pytest.mark.parametrize(
    ("remedy", "says", "never"),
    [
        (
            {"run.collapse": "rest", "run.resting_speed": 0.05},
            "collisions were slower than the resting speed, 0.05",
            "the remedy for inelastic collapse",
        ),
        (
            {"run.collapse": "contact_time", "run.contact_time": 0.01},
            "collisions were made elastic by the remedy for inelastic collapse",
            "resting speed",
        ),
    ],
)
def test_slow_collisions_of_resting_disks_are_not_reported_as_a_remedy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], remedy: dict[str, Any], says: str, never: str
) -> None:
    (tmp_path / "drop.toml").write_text(case_text(remedy, text=CASE))
    assert main(["run", str(tmp_path / "drop.toml"), "-o", f"{tmp_path}/"]) == 0
    printed = capsys.readouterr().out
    assert says in printed
    assert never not in printed
