"""Lines of kernels that a command runs, and those that no command did: coverage of kernels, by quadrants.

    python tests/support/kernel_coverage.py FOLDER pytest tests/simulation/walls     # tests, or
    python tests/support/kernel_coverage.py FOLDER tests/support/same_kernels.py resting    # a script
    python tests/support/kernel_coverage.py FOLDER                                   # what none of these ran

It needs `pip install quadrants coverage`, and variables as for the command (QD_OFFLINE_CACHE_FILE_PATH). Each command
leaves a file in FOLDER. Kernels store a mark before each statement; processes that the command starts leave none.
Compiling with marks takes some two times as long. Lines in `blocks.py`, and those for GPUs only, run on GPUs.
"""

from __future__ import annotations

import ast
import atexit
import json
import os
import runpy
import sys
from collections.abc import Callable, Iterator
from itertools import count, pairwise
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2] / "kernels"
MOST_LINES = 2_000  # of a file; marks are numbered by file and line: cached kernels keep theirs
DECORATORS = ("ti.func", "ti.kernel", "kernel")


def files() -> dict[Path, int]:
    """Modules of kernels, and the number of the mark before the first line of each."""
    return {path: MOST_LINES * i for i, path in enumerate(sorted(ROOT.rglob("*.py")))}


def statements(path: Path) -> Iterator[tuple[str, set[int]]]:
    """Functions of kernels in a module: the name of each, and the lines on which its statements begin."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef) and {ast.unparse(each) for each in node.decorator_list} & {
            *DECORATORS
        }:
            inner = (each for each in ast.walk(node) if isinstance(each, ast.stmt) and each is not node)
            yield node.name, {each.lineno for each in inner if not _is_text(each)}


def _is_text(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def record(folder: Path, command: list[str]) -> int:
    """Run a command in this process and write down the lines that its kernels ran; its exit status."""
    os.environ["IFRDEM_RUNTIME"] = "quadrants"
    import quadrants as qd
    from quadrants.lang import _func_base, _kernel_coverage

    from ifrdem.kernels.compiler import frontends

    first = {str(path): number for path, number in files().items()}
    whole = _kernel_coverage._CoverageASTRewriter

    class Marks(whole):  # type: ignore[misc, valid-type]
        """Marks with numbers of their own, in modules of kernels only."""

        def _make_probe(self, line: int, relative: int, column: int) -> Any:
            path = os.path.realpath(self._filepath.partition(" (kernel ")[0])
            if path not in first:
                return None
            self._filepath, self.next_probe_id = path, first[path] + line
            return super()._make_probe(line, relative, column)

    _kernel_coverage._CoverageASTRewriter = Marks
    # Not by the variable QD_KERNEL_COVERAGE, which processes of tests would inherit.
    for module in (_func_base, sys.modules["quadrants.lang.kernel"]):  # which a function of that name hides
        vars(module)["_kernel_coverage_enabled"] = lambda: True
    frontends._key = lambda *_: None
    _kernel_coverage._reset_hook_installed = True  # that reads marks when the runtime has ended
    atexit.unregister(_kernel_coverage.flush)

    def harvest_before(end: Callable[..., None]) -> Callable[..., None]:
        def ended(**options: Any) -> None:
            if qd.lang.impl.get_runtime()._prog is not None:
                _kernel_coverage._harvest_field()
            end(**options)
            _kernel_coverage._cov_field = None  # reading one makes another

        return ended

    qd.reset, qd.init = harvest_before(qd.reset), harvest_before(qd.init)
    status = _run(command)
    _kernel_coverage._harvest_field()
    folder.mkdir(parents=True, exist_ok=True)
    found = {
        str(Path(path).relative_to(ROOT)): sorted(lines)
        for path, lines in _kernel_coverage._accumulated_lines.items()
    }
    free = next(path for i in count() if not (path := folder / f"{i}.json").exists())
    free.write_text(json.dumps({"command": command, "lines": found}), encoding="utf-8")
    return status


def _run(command: list[str]) -> int:
    if command[0] == "pytest":
        import pytest

        return int(pytest.main([*command[1:], "--runtime", "quadrants"]))
    sys.argv = command
    runpy.run_path(command[0], run_name="__main__")
    return 0


def report(folder: Path) -> None:
    """Print lines of kernels that no command ran, by function."""
    ran: dict[str, set[int]] = {}
    for file in folder.glob("*.json"):
        for name, lines in json.loads(file.read_text(encoding="utf-8"))["lines"].items():
            ran.setdefault(name, set()).update(lines)
    n_run, n_all = 0, 0
    for path in files():
        name = str(path.relative_to(ROOT))
        for function, lines in statements(path):
            missed = sorted(lines - ran.get(name, set()))
            if path.name != "blocks.py":
                n_all, n_run = n_all + len(lines), n_run + len(lines) - len(missed)
            if missed:
                print(f"{name} {function}: {'all' if len(missed) == len(lines) else _ranges(missed)}")
    print(f"{n_run} of {n_all} statements outside blocks.py ran, {100 * n_run / n_all:.1f} %")


def _ranges(lines: list[int]) -> str:
    """Lines as text, such as "3-5, 9"."""
    starts = [lines[0], *(after for before, after in pairwise(lines) if after > before + 2)]
    ends = [*(before for before, after in pairwise(lines) if after > before + 2), lines[-1]]
    return ", ".join(f"{a}-{b}" if b > a else f"{a}" for a, b in zip(starts, ends, strict=True))


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))
    where, what = Path(sys.argv[1]), sys.argv[2:]
    sys.exit(record(where, what) if what else report(where))
