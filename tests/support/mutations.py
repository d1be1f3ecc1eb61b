"""Seeded mutations of the sources, one at a time in a copy of the tree, against the tests of the same folder.

Run from the root of the repository by `PYTHONPATH=tests python -m support.mutations FILES`. A mutant is killed if a
test fails, or if tests take a minute and three times the CPU time that they take without a mutation. Of Python, tests
that execute the line are run; of kernels all of the room.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import random
import re
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

LAW = "tests/kernels/test_law_kernel.py tests/model/laws/test_ifr.py tests/model/laws/test_law.py"
ENGINE = "tests/simulation/test_engine.py tests/simulation/exactness/test_engine_serial_order.py"
ALONE = "tests/kernels/test_tile_functions.py"
FORCES = (
    "tests/model/test_forces.py tests/simulation/test_forces_in_gases.py "
    "tests/simulation/exactness/test_forces_within_windows.py"
)
TILES = f"{ALONE} {ENGINE} tests/simulation/exactness/test_same_bits.py tests/simulation/exactness/test_moments_bits.py"
TESTS = {
    "ifrdem/theory/*": "tests/theory",
    "ifrdem/analysis/*": "tests/analysis tests/cli/test_analysis_command.py",
    "kernels/laws/law.py": LAW,
    "kernels/laws/contact.py": f"{LAW} {ENGINE} tests/simulation/test_ledger.py",
    "kernels/laws/other_laws.py": "tests/model/laws/test_laws.py",
    "kernels/random.py": "tests/kernels/test_random.py",
    "kernels/forces/table_friction.py": "tests/kernels/test_table_friction.py tests/simulation/test_table_force.py",
    "kernels/dsmc.py": "tests/simulation/test_dsmc.py",
    "kernels/disks/flights.py": f"{ENGINE} tests/initial/test_placement.py",
    "kernels/forces/forces.py": FORCES,
    "kernels/forces/force_events.py": f"{FORCES} tests/simulation/test_poisson_forces.py",
    "kernels/disks/force_times.py": "tests/simulation/test_poisson_forces.py",
    "ifrdem/model/forces.py": f"{FORCES} tests/simulation/test_poisson_forces.py",
    "ifrdem/model/laws/*": "tests/model/laws",
    "kernels/disks/stress.py": "tests/simulation/test_stress.py",
    "kernels/disks/shear.py": "tests/simulation/test_shear.py",
    "kernels/events/rest.py": "tests/simulation/walls/test_rest.py tests/simulation/walls/test_turning_gravity.py",
    "kernels/tiles/readout.py": f"{ALONE} tests/simulation/test_readout.py {ENGINE}",
    "kernels/walls/*": "tests/kernels/test_random.py tests/simulation/walls",
    "kernels/events/*": (
        f"{ALONE} {ENGINE} tests/simulation/walls/test_walls.py tests/simulation/test_tracking.py "
        "tests/simulation/test_ledger.py tests/simulation/test_dissipation_per_disk.py"
    ),
    "kernels/disks/particle.py": TILES,
    "kernels/tiles/tiles.py": f"{TILES} tests/simulation/test_shear.py",
    "kernels/windows/windows.py": TILES,
    "kernels/windows/planner.py": TILES,
    "kernels/tiles/sums.py": TILES,
}
OTHER = {
    "Add": "-", "Sub": "+", "Mult": "/", "Div": "*", "Pow": "*", "FloorDiv": "*", "Mod": "//", "Lt": "<=", "LtE": "<",
    "Gt": ">=", "GtE": ">", "Eq": "!=", "NotEq": "==", "And": "or", "Or": "and", "min": "max", "max": "min",
    "minimum": "maximum", "maximum": "minimum", "sin": "cos", "cos": "sin",
}  # fmt: skip
Mutation = dict[str, Any]


def tests_of(file: str) -> str:
    """The tests that belong to a file: those of `TESTS`, else those of its folder. Names, separated by blanks."""
    folder = Path("tests", *Path(file).parts[1 if file.startswith("ifrdem/") else 0 : -1])
    while not folder.exists():
        folder = folder.parent
    return next((tests for pattern, tests in TESTS.items() if fnmatch(file, pattern)), str(folder))


def mutations(file: str) -> Iterator[Mutation]:
    """All of a file: other operators, comparisons, signs, extremes, constants (+2 %, or +1), and dropped statements."""
    data = Path(file).read_bytes()
    lines = data.splitlines(keepends=True)
    start = [sum(map(len, lines[:i])) for i in range(len(lines))]

    def mutation(begin: int, end: int, new: str) -> Mutation:
        line = data[:begin].count(b"\n") + 1
        text = {"text": lines[line - 1].decode().strip(), "old": data[begin:end].decode(), "new": new}
        return {"file": file, "line": line, "begin": begin, "end": end} | text

    def visit(node: Any, inside: bool) -> Iterator[Mutation]:
        kind = type(node).__name__
        names_only = kind == "Assign" and not inside and isinstance(node.targets[0], ast.Tuple)  # of columns
        if names_only or kind in ("Raise", "JoinedStr", "Import", "ImportFrom"):
            return
        if "end_lineno" in node._attributes:
            begin, end = (
                start[node.lineno - 1] + node.col_offset,
                start[node.end_lineno - 1] + node.end_col_offset,
            )
        if kind in ("BinOp", "BoolOp", "Compare", "AugAssign"):
            left = getattr(node, "left", None) or getattr(node, "target", None) or node.values[0]
            op = type(node.ops[0] if kind == "Compare" else node.op).__name__
            after = start[left.end_lineno - 1] + left.end_col_offset
            if op in OTHER and (found := re.compile(rb"[-+*/%<>=!]+|\bor\b|\band\b").search(data, after)):
                new = OTHER[op] + ("=" if kind == "AugAssign" else "")
                yield mutation(found.start(), found.end(), new)
        elif kind == "UnaryOp" and isinstance(node.op, (ast.USub, ast.Not)):
            yield mutation(begin, begin + (1 if isinstance(node.op, ast.USub) else 3), "")
        elif kind == "Constant" and type(node.value) in (int, float) and node.value != 0.0:
            yield mutation(
                begin, end, repr(node.value + (1 if isinstance(node.value, int) else 0.02 * node.value))
            )
        elif kind in ("Name", "Attribute") and (name := node.id if kind == "Name" else node.attr) in OTHER:
            yield mutation(end - len(name), end, OTHER[name])
        place = kind == "Assign" and isinstance(node.targets[0], (ast.Subscript, ast.Attribute))
        if inside and (place or kind == "AugAssign" or (kind == "Expr" and isinstance(node.value, ast.Call))):
            yield mutation(begin, end, "pass")
        for name, value in ast.iter_fields(node):
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST) and name not in ("annotation", "returns", "decorator_list"):
                    yield from visit(child, inside or kind == "FunctionDef")

    yield from visit(ast.parse(data), False)


class Default:
    """Plugin of pytest that leaves out what needs `--full`, also of files that are named."""

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        out = set(sys.modules["support.tiers"].beyond(items))
        items[:] = [item for item in items if item not in out]


class Lines:
    """Plugin of pytest that finds the lines of this folder that each test executes."""

    def __init__(self, folder: str) -> None:
        self.folder, self.found = folder, {}

    def pytest_runtest_protocol(self, item: Any, nextitem: Any) -> None:
        observed = self.found[item.nodeid] = set()

        def trace(frame: Any, event: str, _: object) -> Any:
            name = frame.f_code.co_filename
            if name.startswith(self.folder):
                observed.add(f"{name}:{frame.f_lineno}")
                return trace

        sys.settrace(trace)


def run(tests: list[str], seconds: float, lines: Path | None = None, *, full: bool) -> tuple[bool, float]:
    """True if tests of the present folder all pass, within CPU seconds, and how many it took; to the first failure.

    Without `full`, of files those of the default run; `lines` gets the lines of Python that each executes.
    """
    if (child := os.fork()) == 0:
        resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds)))
        import pytest

        observer = Lines(f"{os.getcwd()}/ifrdem/")
        plugins: list[Any] = [observer] if lines else []
        if not full and "::" not in tests[0]:
            plugins.append(Default())
        options = ["-q", "-x", *(["--full"] if full else []), "-p", "no:cacheprovider"]
        failed = pytest.main([*options, *tests], plugins)
        sys.settrace(None)
        if lines:
            lines.write_text(json.dumps({name: sorted(seen) for name, seen in observer.found.items()}))
        os._exit(int(failed))
    _, status, used = os.wait4(child, 0)
    return status == 0, used.ru_utime + used.ru_stime


def main() -> None:
    """Plant them, and write a line of JSON for each: the mutation, if it survived, and CPU seconds."""
    parser = argparse.ArgumentParser(prog="python -m support.mutations", description=__doc__)
    parser.add_argument("files", nargs="+", help='"ifrdem/theory/*", "kernels/[a-l]*.py", ...')
    parser.add_argument("--count", type=int, default=50, help="mutations of each of FILES (default: 50)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--tests", action="store_true", help="only print the tests that belong to each of FILES"
    )
    parser.add_argument("--default", action="store_true", help="without tests that need `--full`")
    parser.add_argument("--out", type=Path, help="lines of JSON; mutations that are there are left out")
    given = parser.parse_args()
    if given.tests:
        for name in given.files:
            print(name, tests_of(name))
        return
    if given.out is None:
        parser.error("the following arguments are required: --out")
    out = given.out.resolve()
    listed = subprocess.run(["git", "ls-files"], capture_output=True, check=True, text=True).stdout.split(
        "\n"
    )[:-1]
    tested = [name for name in listed if any(fnmatch(name, each) for each in TESTS)]
    draw = random.Random(given.seed)
    chosen: list[Mutation] = []
    for pattern in given.files:
        every = [one for name in tested if fnmatch(name, pattern) for one in mutations(name)]
        print(f"{pattern}: {len(every)} mutations are possible", flush=True)
        chosen += draw.sample(every, min(given.count, len(every)))
    known = [json.loads(line) for line in out.read_text().splitlines()] if out.exists() else []
    with tempfile.TemporaryDirectory() as folder:
        for name in listed:
            Path(folder, name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(name, Path(folder, name), follow_symlinks=False)
        os.chdir(folder)
        os.environ["PYTHONPATH"] = folder
        os.environ.setdefault("TI_OFFLINE_CACHE_FILE_PATH", f"{folder}/.kernels")
        os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
        sys.dont_write_bytecode = True
        sys.path[:0] = [folder, f"{folder}/tests"]
        del sys.modules["support"]
        for library in (
            "taichi",
            "scipy.integrate",
            "matplotlib.pyplot",
            "h5py",
            "pydantic",
            "freud",
            "pytest",
        ):
            __import__(library)  # once for all mutants
        usual: dict[str, tuple[float, dict[str, list[str]]]] = {}
        for one in chosen:
            if any(one.items() <= line.items() for line in known):
                continue
            tests = tests_of(one["file"])
            full = not given.default
            if tests not in usual:
                lines = None if one["file"].startswith("kernels/") else Path("lines.json")
                passed, seconds = run(tests.split(), 3600, lines, full=full)
                assert passed, f"{tests}: there are failures without a mutation"
                usual[tests] = seconds, json.loads(lines.read_text()) if lines else {}
            at = f"{folder}/{one['file']}:{one['line']}"
            some = [name for name, seen in usual[tests][1].items() if at in seen]
            data = Path(one["file"]).read_bytes()
            Path(one["file"]).write_bytes(data[: one["begin"]] + one["new"].encode() + data[one["end"] :])
            survived, seconds = run(some or tests.split(), 3.0 * usual[tests][0] + 60.0, full=full)
            Path(one["file"]).write_bytes(data)
            with out.open("a") as file:
                file.write(json.dumps(one | {"survived": survived, "seconds": round(seconds, 1)}) + "\n")


if __name__ == "__main__":
    main()
