"""Check docstrings beyond what ruff's rules see: ``python docs/check_docstrings.py``.

Every name that users reach (``scp_planner`` exports it or the reference shows it; methods and properties of such a
class, and of its bases, count) has a docstring:

- with sections, it documents all parameters of the signature, in order, and the result;
- the exceptions raised in the body are among those that it names;
- it gives the shape of each array and the unit of each number.

And no docstring in the package, of whatever name, begins with a pronoun.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import logging
import re
import sys
from collections.abc import Collection, Iterator
from pathlib import Path

import griffe

import scp_planner

ROOT = Path(__file__).resolve().parent.parent
REFERENCE = ROOT / "docs" / "reference"
PRONOUN = re.compile(r"\s*(What|Who|Whether|That|Those|The same|Of|It is|How|Where|When|Which)\b")
NOT_HERE = ("cli",)  # documented by their options; see make_reference.py
SHAPE = re.compile(
    r"\([^()]*(?:\d|\.\.\.)[^()]*\)|\(\w\)|\(\w,\)|\(\w \+ \w,\)|\(\w, \w\)|same shape|shape of|scalar", re.IGNORECASE
)
HAVE_UNITS = ("Rule", "Range(", "Above(")  # in kinds that tell their unit themselves
SIZES = re.compile(r"\((?:\w{1,2}|\.\.\.)(?:[ ,+]+(?:\w{1,2}|\.\.\.))*,?\)")  # whose letters are no units
UNIT = re.compile(
    r"(?<![\w/])(?:m|s|rad|Hz|1/m|1/s|m2|m/s2?|m/s3|m/s\^?[23]|m\^2|rad/s|1/\(m s\)|SI(?: units?)?)(?![\w/^])"
    r"|(?i:probabilit|ratio|relative|share|a number|(?:no|same|without a) unit|unit of|units in their names"
    r"|greater than 0 and less than 1)",
)
NUMBER = re.compile(r"\b(?:float|ArrayLike|Array|NDArray|Vector)\b")
A_CLASS = re.compile(
    r"(?:(?:tuple|Row)\[)?[A-Z][A-Za-z]*(?:(?:, \.\.\.)?\])?(?: \| None)?"
)  # which is documented itself
ARRAY = re.compile(r"\b(?:ArrayLike|Array|NDArray)\b")
HELD = re.compile(r"(?:OfParts|TakenAs)\[(.+?)(?:, .*)?\]")  # what a field holds, whatever it is built from


def shown_names() -> frozenset[str]:
    """Give the full names of everything that users reach, without the members of classes."""
    shown = [getattr(scp_planner, name) for name in scp_planner.__all__ if name != "__version__"]
    for page in sorted(REFERENCE.glob("*.md")):
        for module, name in re.findall(r"^::: (\S+)\.(\w+)$", page.read_text(encoding="utf-8"), re.MULTILINE):
            shown.append(getattr(importlib.import_module(module), name))
    inherited = [base for each in shown if inspect.isclass(each) for base in each.__mro__]
    return frozenset(f"{each.__module__}.{each.__name__}" for each in (*shown, *inherited))


def faults(package: str, folder: Path, shown: Collection[str]) -> Iterator[str]:
    """Give the faults of a package in a folder, a line each."""
    logging.getLogger("griffe").setLevel(logging.ERROR)
    for item in _reached(griffe.load(package, search_paths=[folder], docstring_parser="numpy"), shown):
        where = f"{Path(str(item.filepath)).relative_to(folder)}:{item.lineno}: {item.path.partition('.')[2]}"
        yield from (f"{where}: {fault}" for fault in (*_signature_faults(item), *_api_faults(item)))
    for path in sorted((folder / package).rglob("*.py")):
        for line, begins in _pronouns(ast.parse(path.read_text(encoding="utf-8"))):
            yield f"{path.relative_to(folder)}:{line}: docstring: begins with {begins!r}"


def _reached(parent: griffe.Object, shown: Collection[str]) -> Iterator[griffe.Object]:
    """Give the classes and functions that are shown, and the methods and properties of such classes."""
    for name, member in parent.members.items():
        if name.startswith("_") or member.is_alias or (name in NOT_HERE and parent.parent is None):
            continue
        callable_ = member.is_function or "property" in member.labels
        if (member.is_class and member.path in shown) or (callable_ and {member.path, parent.path} & set(shown)):
            yield member  # type: ignore[misc]
        if member.is_module or member.is_class:
            yield from _reached(member, shown)  # type: ignore[arg-type]


def _pronouns(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Give line and pronoun of each docstring that begins with one; strings below attributes are docstrings, too."""
    for node in ast.walk(tree):
        for statement in getattr(node, "body", []) if not isinstance(node, ast.Lambda | ast.IfExp) else []:
            value = statement.value if isinstance(statement, ast.Expr) else None
            if isinstance(value, ast.Constant) and isinstance(value.value, str):
                begins = PRONOUN.match(value.value)
                if begins:
                    yield value.lineno, begins[1]


def _sections(item: griffe.Object) -> dict[str, griffe.DocstringSection]:
    if item.docstring is None:
        return {}
    return {section.kind.value: section for section in item.docstring.parsed}


def _signature(item: griffe.Object) -> list[tuple[str, str]]:
    """Give names and annotations of the parameters that somebody who calls it has to know."""
    if item.is_class:
        init = item.members.get("__init__")
        if init is None or not init.is_function:
            return []
        parameters = init.parameters  # type: ignore[union-attr]
    elif item.is_function:
        parameters = item.parameters  # type: ignore[attr-defined]
    else:
        return []
    return [
        (("*" if "var" in str(each.kind.value) else "") + each.name, str(each.annotation or ""))
        for each in parameters
        if each.name not in ("self", "cls") and not each.name.startswith("_")
    ]


def _signature_faults(item: griffe.Object) -> Iterator[str]:
    sections = _sections(item)
    if not item.has_docstring:
        yield "has no docstring"
        return
    documented = [each.name.lstrip("*") for each in sections["parameters"].value] if "parameters" in sections else []
    expected = [name.lstrip("*") for name, _ in _signature(item)]
    is_long = not sections.keys() <= {"text", "attributes", "admonition", "examples"}
    if (is_long or documented) and documented != expected and not (item.is_class and not expected):
        missing = [name for name in expected if name not in documented]
        unknown = [name for name in documented if name not in expected]
        yield "; ".join(
            [
                *([f"parameters not documented: {', '.join(missing)}"] if missing else []),
                *([f"no such parameters: {', '.join(unknown)}"] if unknown else []),
                *(["parameters are documented in another order"] if not missing and not unknown else []),
            ]
        )
    if item.is_function and is_long:
        returned = str(item.returns or "None")  # type: ignore[attr-defined]
        yields = re.match(r"(?:Iterator|Generator)\[", returned) is not None
        if yields and not {"yields", "returns"} & sections.keys():
            yield "what it yields is not documented"
        elif not yields and returned not in ("None", "NoReturn") and "returns" not in sections:
            yield "what it returns is not documented"
    raised = _raised(item)
    told = [str(each.annotation) for each in sections["raises"].value] if "raises" in sections else []
    silent = sorted(raised - set(re.findall(r"\w+", " ".join(told))))
    if is_long and silent:
        yield f"what it raises is not documented: {', '.join(silent)}"


def _raised(item: griffe.Object) -> set[str]:
    """Give the names of exceptions that are raised in a function's own body, and not caught there."""
    if not item.is_function:
        return set()
    tree = ast.parse("\n".join(_unindented(item)))
    raised = (node.exc for node in ast.walk(tree) if isinstance(node, ast.Raise))
    called = {each.func.id for each in raised if isinstance(each, ast.Call) and isinstance(each.func, ast.Name)}
    return {name for name in called if name.endswith(("Error", "Exception")) and not name.startswith("_")}


def _unindented(item: griffe.Object) -> list[str]:
    lines = item.lines
    indent = len(lines[0]) - len(lines[0].lstrip())
    return [line[indent:] for line in lines]


def _api_faults(item: griffe.Object) -> Iterator[str]:
    """Check what users see: shapes of arrays, units of numbers, nothing left out."""
    sections = _sections(item)
    text = item.docstring.value if item.docstring is not None else ""
    kinds = dict(_signature(item))
    returned = str(getattr(item, "returns", None) or "")
    if "property" in item.labels:
        returned = str(item.annotation or "")  # type: ignore[attr-defined]
    if "parameters" in sections:
        for each in sections["parameters"].value:
            yield from _number_faults(each.name, kinds.get(each.name, ""), f"{each.annotation} {each.description}")
    else:
        for name, kind in kinds.items():
            yield from _number_faults(name, kind, text)
    if "returns" in sections:
        told = " ".join(f"{each.annotation} {each.description}" for each in sections["returns"].value)
        yield from _number_faults("what it returns", returned, told + " " + text.split("\n\n")[0])
    else:
        yield from _number_faults("what it returns", returned, text)
    if item.is_class:
        yield from _attribute_faults(item, sections)


def _attribute_faults(item: griffe.Object, sections: dict[str, griffe.DocstringSection]) -> Iterator[str]:
    described = {}
    if "attributes" in sections:
        for each in sections["attributes"].value:
            for name in each.name.split(", "):
                described[name] = f"{each.annotation} {each.description}"
    for name, member in item.members.items():
        if not member.is_attribute or name.startswith("_") or "property" in member.labels:
            continue
        kind, value = str(member.annotation or ""), str(member.value or "")  # type: ignore[union-attr]
        if held := HELD.fullmatch(kind):
            kind = held[1]
        if (
            "Rule" in kind or not kind or "Range(" in kind or "Above(" in kind or A_CLASS.fullmatch(kind)
        ):  # a range has its unit
            continue
        own = member.docstring.value if member.docstring is not None else ""
        told = " ".join([described.get(name, ""), value, own])
        if name not in described and not own and "description=" not in value:
            yield f"attribute {name} is not documented"
        elif "description=" in value or name in described:
            yield from _number_faults(f"attribute {name}", kind, told)


def _number_faults(name: str, kind: str, text: str) -> Iterator[str]:
    if ARRAY.search(kind) and not SHAPE.search(text):
        yield f"{name}: no shape is given"
    if NUMBER.search(kind) and "Callable" not in kind and not UNIT.search(SIZES.sub("", text)):
        yield f"{name}: no unit is given"


def main() -> None:
    """Print the faults; the exit code says whether there are any."""
    found = list(faults("scp_planner", ROOT, shown_names()))
    sys.stdout.write("".join(f"{fault}\n" for fault in found))
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()
