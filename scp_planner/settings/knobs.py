"""Frozen dataclasses of settings whose fields have a range, a unit and an effect, and are checked."""

from __future__ import annotations

import inspect
import math
import numbers
import re
import types
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, Field, dataclass, fields, replace
from enum import Enum, EnumType
from functools import cache
from typing import Annotated, Any, Self, TypeVar, cast, get_args, get_origin, get_type_hints

from scp_planner import errors
from scp_planner.errors import Fault, SettingsError

Word = TypeVar("Word", bound=Enum)


@dataclass(frozen=True)
class Range:
    """Range of numbers, ends included."""

    least: float
    most: float = math.inf
    unit: str = ""  # SI; empty for a count or a ratio

    def __contains__(self, value: float) -> bool:
        return self.least <= value <= self.most

    def __str__(self) -> str:
        numbers = f"at least {self.least:g}" if self.most == math.inf else f"{self.least:g} to {self.most:g}"
        return f"{numbers} {self.unit}".rstrip()


@dataclass(frozen=True)
class Above(Range):
    """Range of numbers without its lower end."""

    def __contains__(self, value: float) -> bool:
        return self.least < value <= self.most

    def __str__(self) -> str:
        return f"above {self.least:g}, up to {self.most:g} {self.unit}".rstrip()


@dataclass(frozen=True)
class Choice:
    """Allowed words."""

    words: Callable[[], Iterable[str]] | type[Enum]  # Members of an enum, or what is called when they are needed

    def _known(self) -> list[str]:
        return [member.value for member in self.words] if isinstance(self.words, EnumType) else list(self.words())

    def __contains__(self, value: str) -> bool:
        return value in self._known()

    def __str__(self) -> str:
        return "one of " + ", ".join(self._known())


@dataclass(frozen=True)
class Knob:
    """One setting."""

    name: str
    kind: type  # int, float, str or an Enum
    optional: bool
    allowed: Range | Choice | None  # None: settings of their own, not to be set by text
    default: Any
    effect: str

    @property
    def unit(self) -> str:
        """SI unit; empty for a count, a ratio or a word."""
        return self.allowed.unit if isinstance(self.allowed, Range) else ""

    @property
    def allowed_text(self) -> str:
        """Allowed values in words."""
        if self.allowed is None:
            return f"an instance of {self.kind.__name__}"
        number = "" if isinstance(self.allowed, Choice) else "a whole number, " if self.kind is int else "a number, "
        return f"{number}{self.allowed}{', or none' if self.optional else ''}"

    @property
    def default_text(self) -> str:
        """The default, as it is given on a command line."""
        match self.default:
            case None:
                return "none"
            case Enum():
                return str(self.default.value)
            case float():
                return f"{self.default:g}"
            case _:
                return str(self.default)

    def fault(self, value: Any) -> str | None:
        """Say what is wrong with a value; None if nothing is."""
        if self.optional and value is None:
            return None
        if self.allowed is None:
            return None if isinstance(value, self.kind) else f"must be {self.allowed_text}"
        right = isinstance(value, str)
        if isinstance(self.allowed, Range):
            number = numbers.Integral if self.kind is int else numbers.Real
            right = isinstance(value, number) and not isinstance(value, bool)
        return None if right and value in self.allowed else f"must be {self.allowed_text}"

    def parsed(self, text: str) -> Any:
        """Read a value from text, as it is given on a command line; text that is no such value is given back."""
        if self.optional and text.lower() in ("none", "null"):
            return None
        if issubclass(self.kind, Enum):
            return self.kind(text) if text in [member.value for member in self.kind] else text
        try:
            return cast(Any, self.kind)(text)
        except ValueError:
            return text


@dataclass(frozen=True)
class Knobs:
    """Base of a frozen dataclass of settings; see the module.

    Raises
    ------
    SettingsError
        With every unknown name and the nearest known one, and every value that is not allowed.
    """

    def __new__(cls, *args: object, **values: object) -> Self:  # noqa: ARG004 - names alone are looked at
        """Refuse unknown names, which dataclasses do without a hint."""
        _raise(_unknown(cls, values))
        return object.__new__(cls)

    def __post_init__(self) -> None:
        values = {name: getattr(self, name) for name in knobs(type(self))}
        for name, value in values.items():
            # The words of a command line are taken in Python too; what is none is told with the other faults.
            kind = knobs(type(self))[name].kind
            if isinstance(value, str) and issubclass(kind, Enum) and value in [member.value for member in kind]:
                object.__setattr__(self, name, kind(value))
        _raise(
            Fault(name, value, message)
            for name, value in values.items()
            if (message := knobs(type(self))[name].fault(value)) is not None
        )

    @classmethod
    def from_text(cls, assignments: Iterable[str], base: Self | None = None) -> Self:
        """Read settings from texts such as ``path_span=2``.

        Parameters
        ----------
        assignments : iterable of str
            ``name=value`` each.
        base : optional
            What holds for the rest; default: the defaults.

        Returns
        -------
        An instance of the class.

        Raises
        ------
        SettingsError
            With every text that is no assignment, every unknown name and every value that is not allowed.
        """
        values = parse_assignments(assignments, cls)
        return replace(base if base is not None else cls(), **values)


def parse_assignments(assignments: Iterable[str], *classes: type[Knobs]) -> dict[str, Any]:
    """Read texts such as ``path_span=2`` as values of the settings of some classes."""
    known = {name: knob for each in classes for name, knob in knobs(each).items() if knob.allowed is not None}
    faults: list[Fault] = []
    values: dict[str, Any] = {}
    for assignment in assignments:
        name, equals, text = (part.strip() for part in assignment.partition("="))
        if not equals:
            faults.append(Fault(assignment, errors.MISSING, "must be NAME=VALUE"))
        elif name not in known:
            faults.append(unknown_name(name, text, known))
        else:
            values[name] = known[name].parsed(text)
    _raise(faults)
    return values


def knobs(settings: type[Knobs]) -> dict[str, Knob]:
    """Give the settings of a class by name, in order."""
    return _knobs(cast(Any, settings))  # mypy takes no class with fields for hashable


@cache
def _knobs(settings: type[Any]) -> dict[str, Knob]:
    hints = get_type_hints(settings, include_extras=True)
    effects = _effects(settings)
    return {each.name: _knob(each, hints[each.name], effects.get(each.name, "")) for each in fields(settings)}


def _knob(field: Field[Any], hint: Any, effect: str) -> Knob:
    allowed = next((note for note in getattr(hint, "__metadata__", ()) if isinstance(note, Range | Choice)), None)
    kind = get_args(hint)[0] if get_origin(hint) is Annotated else hint
    options = get_args(kind) if isinstance(kind, types.UnionType) else (kind,)
    kinds = [option for option in options if option is not types.NoneType]
    made = field.default_factory
    default = field.default if made is MISSING else made()
    return Knob(field.name, kinds[0], types.NoneType in options, allowed, default, effect)


def _effects(settings: type[Knobs]) -> dict[str, str]:
    """Read the attributes' descriptions out of a docstring in numpydoc's form; none where docstrings are stripped."""
    text = inspect.cleandoc(settings.__doc__ or "")
    _, _, section = text.partition("Attributes\n----------\n")
    entries = re.findall(r"^(\w+)(?: : .*)?\n((?:    .*\n?|\n(?=    ))+)", section, flags=re.MULTILINE)
    return {name: " ".join(description.split()) for name, description in entries}


def _unknown(settings: type[Knobs], values: Mapping[str, object]) -> list[Fault]:
    known = knobs(settings)
    return [unknown_name(name, value, known) for name, value in values.items() if name not in known]


def unknown_name(name: str, value: object, known: Iterable[str]) -> Fault:
    """Give the fault of a name that is no setting, with the nearest one that is."""
    from scp_planner.errors import nearest

    near = nearest(name, known)
    hint = f"; did you mean {near!r}?" if near else ""
    return Fault(name, value, f"there is no such setting{hint}")


def word_of(kind: type[Word], value: object, name: str) -> Word:
    """Turn a word into a member of an enum, which may be given itself."""
    try:
        return kind(value)
    except ValueError:
        allowed = ", ".join(str(member.value) for member in kind)
        raise SettingsError("settings", [Fault(name, value, f"must be one of {allowed}")]) from None


def _raise(faults: Iterable[Fault]) -> None:
    found = list(faults)
    if found:
        raise SettingsError("settings", found)
