"""Reading and writing of YAML and JSON files: every fault with its place, and never half a file."""

from __future__ import annotations

import csv
import errno
import io
import json
import math
import os
import re
import secrets
import shutil
import stat
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import fields
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from scp_planner.errors import MISSING, Fault, FaultyInputError, ScenarioError, below

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

YAML_SUFFIXES = (".yaml", ".yml")
MOST_ENTRIES = 200_000
"""Files and folders that are looked through at most where a folder is asked for with all in it: some seconds."""

JSON_SUFFIX = ".json"

_NAME_KEPT = 16
"""Letters of a file's name, and of its suffix, that the temporary file beside it has too."""
LARGEST_COORDINATE = 1e12
"""m, m/s, m/s2 or s. Beyond it a double no longer resolves a tenth of a millimetre."""

DEEPEST = 100
"""Levels of lists and mappings in a file; no scenario comes near."""

LARGEST_FILE = 2**28
"""Bytes of a file that is read at most."""

MOST_ALIASED = 100_000
"""Values of a YAML file that its aliases stand for, all together."""

_YAML_TAGS = {  # of YAML 1.2: pattern, and the characters that such text begins with
    "null": (r"^(?:~|null|Null|NULL|)$", ["~", "n", "N", ""]),
    "bool": (r"^(?:true|True|TRUE|false|False|FALSE)$", list("tTfF")),
    "int": (r"^[-+]?[0-9]+$", list("-+0123456789")),
    "float": (
        r"^(?:[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$",
        list("-+.0123456789"),
    ),
    "merge": (r"^<<$", ["<"]),
}


def check_extent(folder: str | PathLike[str]) -> None:
    """Refuse a folder that is too large to look through, with all folders in it."""
    seen = 0
    for _, folders, names in os.walk(folder):
        seen += len(folders) + len(names)
        if seen > MOST_ENTRIES:
            raise ValueError(f"holds over {MOST_ENTRIES:,} files, with those in its folders; name a smaller one")


def read_bytes(path: str | PathLike[str]) -> bytes:
    """Read a regular file of bounded size; raise an OSError where it is another kind of file, or larger."""
    # Without O_NONBLOCK, opening a pipe waits for its writer.
    try:
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except ValueError as error:  # a name that no file can have
        raise OSError(errno.EINVAL, str(error), str(path)) from None
    try:
        found = os.fstat(descriptor)
        if not stat.S_ISREG(found.st_mode):
            raise _irregular(found, path, "read")
        if found.st_size > LARGEST_FILE:
            raise OSError(errno.EFBIG, f"must have at most {LARGEST_FILE:,} bytes", str(path))
        with open(descriptor, "rb", closefd=False) as file:
            return file.read(found.st_size)
    finally:
        os.close(descriptor)


def read_text(path: str | PathLike[str], refused: type[FaultyInputError]) -> str:
    """Read a text file, UTF-8; raise an error of a class where it holds other bytes."""
    raw = read_bytes(path)
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        text = f"must be UTF-8 text; byte {error.start} is not"
        raise refused(str(path), [Fault("", raw[error.start : error.start + 1], text)]) from None


def read(
    path: str | PathLike[str], refused: type[FaultyInputError] = ScenarioError
) -> tuple[dict[str, Any], list[Fault]]:
    """Read the mapping that a file holds, and the faults of its keys; raise an error of a class if there is none."""
    suffix = Path(path).suffix.lower()
    if suffix not in (*YAML_SUFFIXES, JSON_SUFFIX):
        raise refused(str(path), [_wrong_suffix(path)])
    parse = parse_json if suffix == JSON_SUFFIX else _parse_yaml
    try:
        data, faults = parse(read_text(path, refused))
    except SyntaxFault as error:
        raise refused(str(path), [error.fault]) from None
    if not isinstance(data, dict):
        raise refused(str(path), [Fault("", data, "must be a mapping of keys to values")])
    return data, faults


def read_json(path: str | PathLike[str], refused: type[FaultyInputError]) -> Any:
    """Read a JSON file; raise an error of a class where the file is not JSON, or a key is in it twice."""
    try:
        data, faults = parse_json(read_text(path, refused))
    except SyntaxFault as error:
        faults = [error.fault]
    if faults:
        raise refused(str(path), faults)
    return data


def read_xml(path: str | PathLike[str], refused: type[FaultyInputError]) -> Element:
    """Read an XML file of CommonRoad; raise an error of a class where it is not XML."""
    from xml.etree import ElementTree

    try:
        return ElementTree.fromstring(read_bytes(path))
    except (ElementTree.ParseError, LookupError, ValueError) as error:  # also encodings that there are not
        raise refused(str(path), [Fault("", MISSING, f"not a CommonRoad file: {error}")]) from None


def write(path: str | PathLike[str], data: dict[str, Any]) -> None:
    """Write a mapping as YAML or JSON, whichever the suffix says; floats keep every bit."""
    suffix = Path(path).suffix.lower()
    if suffix in YAML_SUFFIXES:
        import yaml

        text = yaml.dump(
            data, Dumper=_dumper(), sort_keys=False, default_flow_style=None, allow_unicode=True, width=110
        )
    elif suffix == JSON_SUFFIX:
        text = json.dumps(data, indent=1, allow_nan=False) + "\n"
    else:
        raise ScenarioError(str(path), [_wrong_suffix(path)])
    write_text(path, text)


def write_text(path: str | PathLike[str], text: str) -> None:
    """Write a file as a whole or not at all."""
    with replacing(path) as temporary, open(temporary, "w", encoding="utf-8", newline="\n") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())


def write_rows(path: str | PathLike[str], kind: type, rows: Iterable[Any], without: Sequence[str] = ()) -> None:
    """Write dataclasses of a kind, without some of its fields, as CSV, whole or not at all; floats keep every bit."""
    columns = [field.name for field in fields(kind) if field.name not in without]
    write_csv(path, [columns, *([getattr(row, c) for c in columns] for row in rows)])


def write_csv(path: str | PathLike[str], rows: Iterable[Iterable[Any]]) -> None:
    """Write rows as CSV, whole or not at all; floats keep every bit."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    write_text(path, text.getvalue())


def check_suffix(path: str | PathLike[str], suffixes: Sequence[str]) -> str:
    """Return the suffix of a file to write, in lower case, with its dot; raise a ValueError if it is another one."""
    suffix = Path(path).suffix.lower()
    if suffix not in suffixes:
        raise ValueError(f"{path}: must end in one of {', '.join(suffixes)}")
    return suffix


def text_table(rows: Sequence[Sequence[str]], aligned: str = ">") -> str:
    """Write a table for a terminal: the first column to the left, the others to the right, or as is said."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    sides = ["<", *aligned * (len(widths) - 1)]
    lines = ([f"{c:{side}{w}}" for c, side, w in zip(row, sides, widths, strict=True)] for row in rows)
    return "\n".join("  ".join(line).rstrip() for line in lines)


def regular_target(path: str | PathLike[str]) -> Path:
    """Give the file that is written where a name is written to: a regular one, there or not yet."""
    target = Path(os.path.realpath(path))
    try:
        found = os.stat(path)  # not of the target: a link of the system may stand for what has no name
    except FileNotFoundError:
        return target
    if not stat.S_ISREG(found.st_mode):
        raise _irregular(found, path, "written")
    if any(os.path.samestat(found, stream) for stream in _printed_to()):
        raise OSError(errno.EINVAL, "must not be where what is printed goes", str(path))
    return target


def _irregular(found: os.stat_result, path: str | PathLike[str], done: str) -> OSError:
    """Give the error of what is no regular file."""
    kind = next((name for is_kind, name in _KINDS if is_kind(found.st_mode)), "something else")
    code = errno.EISDIR if stat.S_ISDIR(found.st_mode) else errno.EINVAL
    return OSError(code, f"must not be {kind}; only regular files are {done}", str(path))


_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
)


def _printed_to() -> Iterator[os.stat_result]:
    """Look at what stdout and stderr go to, as far as they are open."""
    for descriptor in (1, 2):
        with suppress(OSError):
            yield os.fstat(descriptor)


@contextmanager
def replacing(path: str | PathLike[str]) -> Iterator[Path]:
    """Give a temporary file beside a file, with its suffix; it takes the file's name if all goes well."""
    target = regular_target(path)
    # What a name adds to is cut: the longest names that there are must fit.
    begin, end = target.stem[:_NAME_KEPT], target.suffix[-_NAME_KEPT:]
    name = target.with_name(f".{begin}.{secrets.token_hex(4)}.part{end}")
    try:
        # It is made in here, for an interrupt just after that would leave it.
        _make_empty(name)
        yield name
        os.chmod(name, _usual_mode(target))
        os.replace(name, target)
    except BaseException:
        name.unlink(missing_ok=True)
        raise


@contextmanager
def temporary_folder(parent: Path) -> Iterator[Path]:
    """Make a folder in another one for as long as it is needed."""
    name = parent / f".{secrets.token_hex(4)}.part"
    try:
        # As above; those of `tempfile` are left behind by an interrupt just after they were made.
        name.mkdir(0o700)
        yield name
    finally:
        shutil.rmtree(name, ignore_errors=True)


def try_to_write(folder: Path) -> None:
    """Make a file in a folder, and remove it."""
    name = folder / f".{secrets.token_hex(4)}.part"
    try:
        _make_empty(name)
    finally:
        name.unlink(missing_ok=True)


def _make_empty(name: Path) -> None:
    """Make an empty file, for the owner alone, that is not there yet."""
    os.close(os.open(name, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600))


def _usual_mode(target: Path) -> int:
    """Give the permissions of the file to replace, or of any new file: mkstemp's are for the owner alone."""
    try:
        return target.stat().st_mode & 0o777
    except FileNotFoundError:
        mask = os.umask(0)
        os.umask(mask)
        return 0o666 & ~mask


class SyntaxFault(Exception):
    """The text is not YAML or JSON at all."""

    def __init__(self, text: str, line: int | None, message: str) -> None:
        lines = text.splitlines()
        value = lines[line - 1].strip() if line is not None and 0 < line <= len(lines) else text
        self.fault = Fault("" if line is None else f"line {line}", value, message)


_NESTED = f"must not be nested deeper than {DEEPEST} levels"


def _wrong_suffix(path: str | PathLike[str]) -> Fault:
    suffixes = ", ".join((*YAML_SUFFIXES, JSON_SUFFIX))
    return Fault("file name", Path(path).name, f"must end in one of {suffixes}")


def parse_json(text: str) -> tuple[Any, list[Fault]]:
    """Parse JSON, and list the keys that are in it twice; raise a SyntaxFault."""
    try:
        data = json.loads(text, object_pairs_hook=_Mapping)
        return data, list(_key_faults(data, "", set()))
    except RecursionError:
        raise SyntaxFault(text, None, _NESTED) from None
    except ValueError as error:  # also whole numbers of thousands of digits
        said = f"must be JSON: {getattr(error, 'msg', error)}"
        raise SyntaxFault(text, getattr(error, "lineno", None), said) from None


class _Mapping(dict[str, Any]):
    """Keys and values of a file, and those whose key was there before, with their line if that is known."""

    def __init__(self, pairs: Sequence[tuple[str, Any]], lines: Sequence[str] = ()) -> None:
        super().__init__(pairs)
        self.repeated: list[tuple[str, Any, str]] = []
        if len(self) < len(pairs):
            seen: set[str] = set()
            for number, (key, value) in enumerate(pairs):
                if key in seen:
                    self.repeated.append((key, value, lines[number] if lines else ""))
                seen.add(key)


def _key_faults(data: Any, path: str, seen: set[int], level: int = 0) -> Iterator[Fault]:
    """Yield the keys that are there twice; raise a RecursionError where lists and mappings are nested too deeply."""
    if id(data) in seen or not isinstance(data, (dict, list)):  # an alias: looked at where its anchor stands
        return
    seen.add(id(data))
    if level > DEEPEST:
        raise RecursionError
    if isinstance(data, _Mapping):
        for key, value, line in data.repeated:
            yield Fault(below(path, key), value, f"must be given only once; this is a repeated key{line}")
        parts = [(below(path, key), value) for key, value in data.items()]
    else:
        parts = [(f"{path}[{i}]", item) for i, item in enumerate(data) if isinstance(item, (dict, list))]
    for place, part in parts:
        yield from _key_faults(part, place, seen, level + 1)


def _parse_yaml(text: str) -> tuple[Any, list[Fault]]:
    import yaml

    kind = _loader()
    try:
        _check_nodes(text, kind)
        data = yaml.load(text, Loader=kind)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = None if mark is None else mark.line + 1
        said = "; ".join(str(part) for part in (error.context, error.problem) if part)
        raise SyntaxFault(text, line, f"must be YAML: {said}") from None
    except (yaml.YAMLError, ValueError) as error:
        raise SyntaxFault(text, None, f"must be YAML: {error}") from None
    return data, list(_key_faults(data, "", set()))


def _check_nodes(text: str, kind: Any) -> None:
    """Refuse nesting that would overrun the stack, and aliases that stand for too much, before any of it is built."""
    import yaml

    opened: list[tuple[str | None, int]] = []  # anchors of the lists and mappings that are open, nodes before them
    sizes: dict[str, int] = {}
    nodes = aliased = 0
    for event in yaml.parse(text, Loader=kind):
        line = event.start_mark.line + 1 if event.start_mark else None
        if isinstance(event, yaml.AliasEvent):
            size = sizes.get(str(event.anchor), 1)
            nodes, aliased = nodes + size, aliased + size
        elif isinstance(event, yaml.NodeEvent):
            nodes += 1
        if isinstance(event, yaml.CollectionStartEvent):
            opened.append((event.anchor, nodes))
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = opened.pop()
            if anchor is not None:
                sizes[anchor] = nodes - before + 1
        if len(opened) > DEEPEST:
            raise SyntaxFault(text, line, _NESTED)
        if aliased > MOST_ALIASED:
            raise SyntaxFault(text, line, f"must not stand for more than {MOST_ALIASED:,} values by its aliases")


def _loader() -> Any:
    """Make a safe loader with the numbers, booleans and nulls of YAML 1.2, the C one where there is one."""
    import yaml

    class Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
        yaml_implicit_resolvers: ClassVar[dict[str, Any]] = {}

    _resolve(Loader, _YAML_TAGS)

    def mapping(loader: Any, node: Any) -> Iterator[_Mapping]:
        made = _Mapping(())
        yield made  # before its values are there: an alias in them may stand for it
        pairs = [(key.value, loader.construct_object(value)) for key, value in node.value]
        made.repeated = _Mapping(pairs, [f" (line {key.start_mark.line + 1})" for key, _ in node.value]).repeated
        made.update(loader.construct_mapping(node))

    Loader.add_constructor("tag:yaml.org,2002:map", mapping)
    Loader.add_constructor("tag:yaml.org,2002:int", lambda loader, node: int(loader.construct_scalar(node)))
    Loader.add_constructor("tag:yaml.org,2002:float", lambda loader, node: _float(loader.construct_scalar(node)))
    return Loader


def _resolve(kind: Any, tags: Iterable[str]) -> None:
    for tag in tags:
        pattern, first = _YAML_TAGS[tag]
        kind.add_implicit_resolver(f"tag:yaml.org,2002:{tag}", re.compile(pattern), first)


def _float(text: str) -> float:
    digits = text.lower().replace(".inf", "inf")
    return math.nan if digits == ".nan" else float(digits)


def _dumper() -> Any:
    """Make a dumper that quotes text which a reader of YAML 1.1 or 1.2 would take for something else."""
    import yaml

    class Dumper(yaml.SafeDumper):
        def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002 - as yaml calls it
            return True

    def text(dumper: Any, value: str) -> Any:
        # In double quotes alone does the emitter escape every control character and line separator.
        return dumper.represent_scalar("tag:yaml.org,2002:str", value, style=None if value.isprintable() else '"')

    Dumper.add_representer(str, text)
    _resolve(Dumper, ("float", "int"))
    return Dumper
