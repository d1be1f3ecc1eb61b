"""`validate device`: its comparisons, on a machine without a GPU those of the CPU with itself."""

from __future__ import annotations

import numpy as np
import pytest

from ifrdem.cli import main as cli
from ifrdem.simulation import backend
from ifrdem.validation.devices import bits, races, speed
from ifrdem.validation.report.registry import Skip

WITHOUT_GPU = pytest.mark.skipif(backend.cuda_absence() is None, reason="there is a GPU")


@pytest.mark.full
@pytest.mark.parametrize("name", bits.EXACT)
def test_tiles_of_few_disks_give_the_bits_of_one_tile_in_windows_of_one_length(name: str) -> None:
    """The state that a GPU is compared by: the state in one tile, after windows as short as its own."""
    gas = bits.EXACT[name](600)
    alone = bits.after(gas, 4.0, "cpu")
    tiles = bits.after(gas, 4.0, "cpu", order="tiled", tile_disks=60)
    assert alone.arrays.tiles == 1
    assert tiles.arrays.tiles > 1
    assert alone.statistics.windows == tiles.statistics.windows > 4
    assert bits.differing(alone.state(), tiles.state()) == 0


def test_windows_of_another_length_give_other_bits_and_the_same_collisions() -> None:
    gas = bits.thin(600)
    states = [bits.after(gas, 4.0, "cpu").state()]
    original, bits.WINDOW = bits.WINDOW, 0.7
    try:
        states.append(bits.after(gas, 4.0, "cpu").state())
    finally:
        bits.WINDOW = original
    assert bits.differing(*states) > 600
    np.testing.assert_allclose(states[0].position, states[1].position, atol=1e-8)


@WITHOUT_GPU
@pytest.mark.parametrize("case", [bits, races, speed])
def test_without_a_gpu_the_cases_are_skipped_with_the_reason(case) -> None:
    with pytest.raises(Skip, match="no GPU: "):
        case.run(True)


@WITHOUT_GPU
def test_without_a_gpu_there_is_one_message_and_no_report(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(["validate", "device"]) == 2
    assert capsys.readouterr().err.startswith("ifrdem: device: there is no GPU to validate: ")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.full
def test_every_row_of_the_cpu_against_itself_passes() -> None:
    result = bits.run(True, device="cpu")
    assert len(result.rows) > 20
    assert [row.quantity for row in result.rows if not row.passed] == []


def test_a_state_with_one_bit_turned_fails_its_row() -> None:
    gas = bits.thin(100)
    state = bits.after(gas, 1.0, "cpu").state()
    spin = state.spin.copy()
    spin[3] = np.nextafter(spin[3], 2.0)
    other = type(state)(state.position, state.velocity, spin, image=state.image, collisions=state.collisions)
    assert bits.differing(state, other) == 1
