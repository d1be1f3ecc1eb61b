"""Arrays are copied from and to NumPy by memory on a CPU: the same numbers as by the runtime's own kernels."""

from __future__ import annotations

import inspect
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ifrdem import Device
from ifrdem.kernels.compiler import language, runtime, start_patches
from ifrdem.kernels.compiler.language import from_numpy, ti, to_numpy
from ifrdem.simulation import backend

ROOT = Path(__file__).parents[2]


@pytest.mark.full(keep=2)
@pytest.mark.parametrize("kind", ["f64", "f32", "i32"])
@pytest.mark.parametrize("vector", [None, 3])
@pytest.mark.parametrize("shape", [(7,), (4, 5), (2, 3, 4)])
def test_copies_by_memory_are_those_of_kernels(
    kind: str, vector: int | None, shape: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    backend.start(Device("cpu", threads=1))

    def made(values: np.ndarray) -> Any:
        of = getattr(ti, kind)
        found = ti.ndarray(of, shape) if vector is None else ti.Vector.ndarray(vector, of, shape)
        from_numpy(found, values)
        return found

    whole = shape if vector is None else (*shape, vector)
    values = (
        np.arange(np.prod(whole), dtype=np.float64).reshape(whole)[::-1] * 1.5
    )  # neither its type nor contiguous
    array = made(values)
    expected = values.astype({"f64": np.float64, "f32": np.float32, "i32": np.int32}[kind])
    np.testing.assert_array_equal(to_numpy(array), expected)
    assert to_numpy(array).dtype == expected.dtype
    with pytest.raises(ValueError, match="an array of shape"):
        from_numpy(array, values[1:])
    monkeypatch.setattr(language, "on_gpu", lambda: True)  # then by kernels
    np.testing.assert_array_equal(to_numpy(array), expected)
    by_kernel = made(expected)
    monkeypatch.undo()
    np.testing.assert_array_equal(to_numpy(by_kernel), expected)


def test_a_runtime_that_cannot_be_loaded_is_one_message_with_its_remedy(tmp_path: Path) -> None:
    """A module of that name fails as Taichi's library does on a system without libX11."""
    text = "libX11.so.6: cannot open shared object file: No such file or directory"
    (tmp_path / f"{runtime.chosen()}.py").write_text(f"raise ImportError({text!r})\n")
    line = (
        "import sys; from ifrdem.cli.main import main; sys.exit(main(['run', 'impact_scan', '-o', 'one.h5']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", line],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (tmp_path, ROOT, *sys.path)))},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert text in done.stderr
    assert "apt install libx11-6" in done.stderr
    assert not list(tmp_path.glob("one*"))


STATE = """
import sys
import numpy as np
from ifrdem.kernels.compiler import runtime
if sys.argv[1] == "other":
    runtime.SAME_BITS.clear()
import ifrdem
from ifrdem.kernels.compiler.language import ti
disks = ifrdem.Disks(64, mass=1.0, radius=0.5)
box = ifrdem.Box.from_packing_fraction(disks.radius, 0.2)
position = ifrdem.initial.random_positions(box, disks.radius, seed=1)
velocity = ifrdem.initial.maxwellian(disks.mass, temperature=1.0, seed=1)
start = ifrdem.State(position, velocity, np.zeros(disks.n))
gas = ifrdem.Simulation(disks, box, ifrdem.IFRLaw(e_n=0.9, e_t=-0.9, mu=0.15), start, device=ifrdem.Device(threads=1))
gas.run(t_end=1.0)
print(type(ti.lang.kernel_impl._inside_class).__name__, gas.collisions, gas.state.position.tobytes().hex())
"""


@pytest.mark.full
def test_another_version_of_a_runtime_gets_no_patches_and_the_same_bits() -> None:
    """Patches save time only: without them the runtime's own functions do the same."""
    found = {}
    for version in ("this", "other"):
        done = subprocess.run(
            [sys.executable, "-c", STATE, version], cwd=ROOT, capture_output=True, text=True, check=True
        )
        kind, *found[version] = done.stdout.splitlines()[-1].split()
        assert kind == ("partial" if version == "this" else "function")
    assert found["this"] == found["other"]
    assert int(found["this"][0]) > 10


def test_plain_parameters_and_templates_are_noted_without_inspect() -> None:
    """All others are read by quadrants' own method: what it does not take has its messages."""
    template = type("Template", (), {})
    gas = template()

    def noted(function: Callable[..., Any], **kind: bool) -> list[tuple[str, Any]] | None:
        kinds = {"is_kernel": False, "is_real_function": False, "is_classfunc": False, **kind}
        one = SimpleNamespace(func=function, arg_metas=[], orig_arguments=[], **kinds)
        left: list[Any] = []
        start_patches._note_parameters(one, left.append, lambda kind, name: (name, kind), template)
        if left:
            assert one.arg_metas == []
            return None
        assert one.orig_arguments == one.arg_metas
        assert one.template_slot_locations == [i for i, (_, kind) in enumerate(one.arg_metas) if kind is gas]
        return list(one.arg_metas)

    def plain(i, gas, x):  # type: ignore[no-untyped-def]
        y = x
        return y

    plain.__annotations__ = {"gas": gas}

    empty = inspect.Parameter.empty
    assert noted(plain) == [("i", empty), ("gas", gas), ("x", empty)]
    assert noted(lambda: 0) == []
    for kind in ("is_kernel", "is_real_function", "is_classfunc"):
        assert noted(plain, **{kind: True}) is None

    def typed(x: int): ...  # type: ignore[no-untyped-def]
    def returns(x): ...  # type: ignore[no-untyped-def]

    returns.__annotations__ = {"return": gas}
    for function in (returns, typed, lambda x=1: x, lambda *x: x, lambda **x: x, lambda *, x: x):
        assert noted(function) is None
