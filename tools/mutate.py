"""Mutation run: break one expression at a time in some packages, and see whether their tests notice.

``python tools/mutate.py --sample 20 --seed 1`` breaks 20 expressions each of the certificate, the safety gate and the
threat zones, one at a time, in a copy of the project, and runs the tests that matter for the file, quick ones first,
until one fails. It prints the survivors, and the share of mutants that were noticed.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
QUICK = tuple(
    f"online/test_{name}.py"
    for name in ("stops", "border", "futures", "reported_states", "braking", "ends", "following")
)
PLANS = tuple(f"planning/test_{name}.py" for name in ("plan", "in_tube", "open_goals"))
PARTS = {
    "certificate": (("scp_planner/certificate",), ("certificate", *QUICK, *PLANS, "planning/test_meeting.py")),
    "gate": (
        ("scp_planner/online/safety_gate.py",),
        ("online/test_safety_gate.py", *QUICK, "online/test_exact_looks.py"),
    ),
    "zones": (("scp_planner/threat_zones",), ("threat_zones", *QUICK, "search", *PLANS, "certificate")),
}
"""Files that are broken, and the tests that have to notice, quick ones first."""
COPIED = ("scp_planner", "tests", "verification", "benchmarks", "examples", "docs", "pyproject.toml", "README.md")
SMALLEST = 1e-100
"""Smaller constants guard a division by zero."""
PATIENCE = 4.0
"""Times the tests of what is not broken: a mutant that takes longer is noticed."""
COMPARISONS: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
TURNED: dict[type[ast.cmpop], type[ast.cmpop]] = {ast.Lt: ast.Gt, ast.LtE: ast.GtE, ast.Gt: ast.Lt, ast.GtE: ast.LtE}
SWAPPED: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """One expression of a file in place of another."""

    part: str
    file: str
    line: int
    span: tuple[int, int]
    new: str
    old: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.old}  ->  {self.new}"


def find_mutants(part: str, file: Path) -> Iterator[Mutant]:
    """Find all mutants of a file: comparisons, operators, constants, terms, conditions."""
    text = file.read_text(encoding="utf-8")
    starts = [0]
    for line in text.encode().splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    tree = ast.parse(text)
    idle = [part for node in ast.walk(tree) for part in _idle_parts(node) if part is not None]
    skipped = {id(inner) for part in idle for inner in ast.walk(part)}
    for node in ast.walk(tree):
        if not isinstance(node, ast.expr) or id(node) in skipped or node.end_lineno is None:
            continue
        assert node.end_col_offset is not None
        span = (starts[node.lineno - 1] + node.col_offset, starts[node.end_lineno - 1] + node.end_col_offset)
        for new in _changed(node):
            name = str(file.relative_to(ROOT))
            yield Mutant(part, name, node.lineno, span, f"({ast.unparse(new)})", ast.unparse(node))


def _idle_parts(node: ast.AST) -> Iterator[ast.AST | None]:
    """Parts without an effect on a result: types, texts, logs, decorators, checks of equal lengths, guards."""
    match node:
        case ast.If(test=ast.Name(id="TYPE_CHECKING")) | ast.JoinedStr() | ast.Expr(value=ast.Constant()):
            yield node
        case ast.Raise(exc=exception):
            yield exception
        case ast.Call(func=ast.Attribute(value=ast.Name(id="_log" | "logger" | "logging"))):
            yield node
        case ast.FunctionDef() | ast.ClassDef():
            yield from node.decorator_list
        case ast.keyword(arg="strict", value=value):
            yield value
        case ast.Constant(value=float() as value) if 0.0 < value < SMALLEST:
            yield node
    yield from (getattr(node, name, None) for name in ("annotation", "returns"))


def _changed(node: ast.expr) -> Iterator[ast.expr]:
    """Break the logic of an expression."""
    match node:
        case ast.Compare(left=left, ops=[op], comparators=comparators):
            for table in (COMPARISONS, TURNED):
                if type(op) in table and (table is TURNED or type(op) not in TURNED or _counts(left, *comparators)):
                    yield ast.Compare(left, [table[type(op)]()], comparators)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in SWAPPED:
            yield ast.BinOp(left, SWAPPED[type(op)](), right)
            if isinstance(op, ast.Add | ast.Sub):
                yield left  # a term is dropped
        case ast.BoolOp(op=op, values=values):
            yield ast.BoolOp(ast.Or() if isinstance(op, ast.And) else ast.And(), values)
            yield from (values[0], values[-1])
        case ast.UnaryOp(op=ast.Not() | ast.USub(), operand=operand):
            yield operand
        case ast.IfExp(body=body, orelse=orelse):
            yield from (body, orelse)
    yield from _changed_values(node)


def _counts(*sides: ast.expr) -> bool:
    """Return True if a comparison may be of counts or with zero: two other numbers are hardly ever equal."""
    constants = [side.value for side in sides if isinstance(side, ast.Constant)]
    called = [side.func for side in sides if isinstance(side, ast.Call)]
    return any(isinstance(value, int) or value == 0 for value in constants) or any(
        isinstance(function, ast.Name) and function.id == "len" for function in called
    )


def _changed_values(node: ast.expr) -> Iterator[ast.expr]:
    """Break constants and bounds."""
    match node:
        case ast.Constant(value=bool() as value):
            yield ast.Constant(not value)
        case ast.Constant(value=int() | float() as value):
            yield ast.Constant(value + 1 if isinstance(value, int) else 1.5 * value if value else 1.0)
        case ast.Call(func=ast.Attribute(value=owner, attr="minimum" | "maximum" as name), args=[first, second]):
            other = "maximum" if name == "minimum" else "minimum"
            yield ast.Call(ast.Attribute(owner, other), [first, second], [])
        case ast.Call(func=ast.Name(id="min" | "max" as name), args=arguments, keywords=keywords):
            yield ast.Call(ast.Name("max" if name == "min" else "min"), arguments, keywords)


def run_tests(folder: Path, tests: Sequence[str], patience: float | None) -> bool:
    """Run tests in a copy of the project; return True if they all pass, in time."""
    paths = [f"tests/{name}" for name in tests]
    command = [sys.executable, "-B", "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-p", "no:randomly", *paths]
    environment = {**os.environ, "PYTHONPATH": str(folder), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    try:
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, timeout=patience, check=False)
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def try_mutant(folder: Path, mutant: Mutant, patience: float) -> bool:
    """Return True if the tests notice a mutant."""
    file = folder / mutant.file
    whole = file.read_bytes()
    begin, end = mutant.span
    try:
        file.write_bytes(whole[:begin] + mutant.new.encode() + whole[end:])
        return not run_tests(folder, order_tests(folder, mutant), patience)
    finally:
        file.write_bytes(whole)


def order_tests(folder: Path, mutant: Mutant) -> list[str]:
    """Name the tests of a mutant's part; first the one that is named like its file, if there is one."""
    tests, name = PARTS[mutant.part][1], f"test_{Path(mutant.file).name}"
    own = [f"{test}/{name}" for test in tests if (folder / "tests" / test / name).is_file()]
    return [*own, *tests]


def draw_mutants(parts: Sequence[str], sample: int, seed: int) -> list[Mutant]:
    """Draw so many mutants of each part."""
    drawn = []
    for part in parts:
        places = [ROOT / name for name in PARTS[part][0]]
        files = [file for place in places for file in (sorted(place.glob("*.py")) if place.is_dir() else [place])]
        every = [mutant for file in files for mutant in find_mutants(part, file)]
        drawn += random.Random(f"{seed} {part}").sample(every, min(sample, len(every)))
    return drawn


def main(argv: Sequence[str] | None = None, say: Callable[[str], None] = print) -> int:
    """Run the command; return 1 if tests fail of what is not broken."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--part", action="append", choices=PARTS, help="repeatable; default: all")
    parser.add_argument("--sample", type=int, default=20, help="mutants of each part (default: 20)")
    parser.add_argument("--seed", type=int, default=0, help="of the sample (default: 0)")
    parser.add_argument("--minutes", type=float, default=60.0, help="after which none is begun (default: 60)")
    options = parser.parse_args(argv)
    parts = options.part or list(PARTS)
    until = time.monotonic() + 60.0 * options.minutes
    noticed: dict[str, list[bool]] = {part: [] for part in parts}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for each in COPIED:
            whole = ROOT / each
            copy = shutil.copytree if whole.is_dir() else shutil.copy
            copy(whole, folder / each)
        took = {}
        for part in parts:
            began = time.monotonic()
            if not run_tests(folder, PARTS[part][1], None):
                say(f"{part}: its tests fail before anything is broken")
                return 1
            took[part] = time.monotonic() - began
        mutants = draw_mutants(parts, options.sample, options.seed)
        random.Random(options.seed).shuffle(mutants)
        for mutant in mutants:
            if time.monotonic() > until:
                break
            found = try_mutant(folder, mutant, PATIENCE * took[mutant.part] + 10.0)
            noticed[mutant.part].append(found)
            if not found:
                say(f"survives: {mutant}")
    for part, results in noticed.items():
        say(f"{part}: {sum(results)} of {len(results)} noticed; its tests take {took[part]:.1f} s")
    together = [found for results in noticed.values() for found in results]
    say(f"score {100.0 * sum(together) / max(len(together), 1):.0f} % of {len(together)}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
