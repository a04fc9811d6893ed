"""Parts of an input file as frozen models that report everything that is wrong with them at once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING as NO_DEFAULT
from dataclasses import dataclass, fields
from functools import lru_cache
from os import PathLike
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Self, TypeAlias, TypeVar, get_args, get_origin, get_type_hints

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    ModelWrapValidatorHandler,
    TypeAdapter,
    ValidationError,
    model_validator,
)
from pydantic_core import InitErrorDetails, PydanticCustomError, core_schema

from scp_planner.errors import MISSING, Fault, FaultyInputError, ScenarioError, nearest

T = TypeVar("T")
Held = TypeVar("Held")
Taken = TypeVar("Taken")

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    Numbers: TypeAlias = ArrayLike
    Row: TypeAlias = Sequence[T]
    Pair: TypeAlias = Sequence[T]

    class TakenAs(Generic[Held, Taken]):
        """`TakenAs[Held, Taken]`: type checkers let a part be built from the second type, and read the first one."""

        def __get__(self, part: object, kind: Any = None) -> Held:
            raise NotImplementedError

        def __set__(self, part: object, value: Taken) -> None:
            raise NotImplementedError

    OfNumbers: TypeAlias = TakenAs[T, Numbers]
    OfParts: TypeAlias = TakenAs[T, T | Mapping[str, Any]]
else:
    Numbers = Any

    class Row:
        """`Row[X]`: to whoever gives it any sequence, also a list; once it is there a tuple."""

        def __class_getitem__(cls, item: Any) -> Any:
            return tuple[item, ...]

    class Pair:
        """`Pair[X]`: the same of two entries."""

        def __class_getitem__(cls, item: Any) -> Any:
            return tuple[item, item]

    class TakenAs:
        """`TakenAs[Held, Taken]`, `OfNumbers[Held]`, `OfParts[Held]`: what is held."""

        def __class_getitem__(cls, item: Any) -> Any:
            return item[0] if isinstance(item, tuple) else item

    OfNumbers = OfParts = TakenAs


@dataclass(frozen=True)
class FiledAs:
    """Annotation of a field that files hold as another type: what makes it of that, and that of it."""

    kind: Any
    made: Callable[[Any], Any]
    written: Callable[[Any], Any]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        """Give the schema of a field, as pydantic asks for it."""
        writing = core_schema.plain_serializer_function_ser_schema(self.written)
        kind = handler.generate_schema(self.kind)
        return core_schema.no_info_after_validator_function(self.made, kind, serialization=writing)


def by_default(default: Any, **about: Any) -> Any:
    """Describe a field that may be left out; a default of what is held fits no `TakenAs` to a type checker."""
    return Field(default=default, **about)


Location = tuple[int | str, ...]

_FAULT = "fault"  # the error type of what is already in our own words


@dataclass(frozen=True)
class Objection:
    """Finding of a rule: a location below the part that it looks at, the value there, the allowed ones."""

    location: Location
    value: object
    message: str


class Unknown(Exception):
    """A rule asked for a field that is faulty itself: the rule has nothing to say."""


class Salvage:
    """The valid fields of a faulty part."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        self.__dict__.update(values)

    def __getattr__(self, name: str) -> Any:
        raise Unknown(name)

    def __repr__(self) -> str:
        return repr(self.__dict__)


Rule = Callable[[Any], Iterator[Objection]]


class _Many:
    """Shows the first of many values."""

    def __init__(self, values: tuple[Any, ...]) -> None:
        self.values = values

    def __repr__(self) -> str:
        return f"({self.values[0]!r}, ... {len(self.values)} in all)"


class Part(BaseModel):
    """A frozen piece of a scenario; built from its fields, each a value, a model or a dictionary.

    Parameters
    ----------
    **data
        The fields.

    Raises
    ------
    ScenarioError
        With every fault, where pydantic alone would raise its own `ValidationError`.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True, allow_inf_nan=False)

    rules: ClassVar[tuple[Rule, ...]] = ()
    """Rules by which the fields must fit together."""

    def __init__(self, **data: Any) -> None:
        try:
            super().__init__(**data)
            return
        except ValidationError as error:
            faults = faults_of(error)
        # Not while the other is handled: it would be pickled as this one's context, where some cannot be read again.
        raise ScenarioError(type(self).__name__, faults)

    def __setattr__(self, name: str, value: Any) -> None:
        if name in type(self).model_fields:
            copy = f"model_copy(update={{'{name}': ...}})"
            raise ValueError(f"{type(self).__name__}.{name} is frozen; {copy} is a changed copy")
        super().__setattr__(name, value)

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Copy with some fields changed; dictionaries and lists are read, and the whole is checked, as in a file.

        Parameters
        ----------
        update : mapping of str to value, optional
        deep : bool
            Of pydantic: copy what the parts hold, too.

        Returns
        -------
        A part of the same kind.

        Raises
        ------
        ScenarioError
            If there is no such field, or what was read is not allowed.
        """
        changes, known = update or {}, type(self).model_fields
        unknown = [unknown_key(name, value, known) for name, value in changes.items() if name not in known]
        if unknown:
            raise ScenarioError(type(self).__name__, unknown)
        if any(isinstance(value, dict | list) for value in changes.values()):
            kind: Any = type(self)
            return kind(**{**dict(self), **changes})
        return super().model_copy(update=update, deep=deep)

    def __repr_args__(self) -> Iterator[tuple[str | None, Any]]:
        for name, value in super().__repr_args__():
            yield name, _Many(value) if isinstance(value, tuple) and len(value) > 4 else value

    # pydantic calls an overridden __init__ for nested dictionaries too, and would lose the paths of their
    # faults. This mark, which its own RootModel carries, says that the override only passes on.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @model_validator(mode="wrap")
    @classmethod
    def _collect_faults(cls, data: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        data = _without_arrays(data)
        errors: list[InitErrorDetails] = []
        part: Any
        try:
            part = handler(data)
        except ValidationError as error:
            errors = _in_our_words(cls, error)
            part = _salvage(cls, data)
        for rule in cls.rules:
            try:
                errors.extend(_details(p.location, p.value, p.message) for p in rule(part))
            except Unknown:
                continue
        if errors:
            raise ValidationError.from_exception_data(cls.__name__, errors)
        checked: Self = part
        return checked


AnyPart = TypeVar("AnyPart", bound=Part)


def key_of(part: type[Part], name: str) -> str:
    """Give the key that a field has in a file; where that is a word of Python, the field has another name."""
    alias = part.model_fields[name].validation_alias
    return alias if isinstance(alias, str) else name


def faults_of(error: ValidationError) -> list[Fault]:
    """Give the faults that pydantic collected, in the order of the file's keys where it has one."""
    return [Fault(_path(e["loc"]), e["input"], e["msg"]) for e in error.errors(include_url=False)]


def part_of_file(
    kind: type[AnyPart],
    source: str | PathLike[str],
    data: Any,
    error: type[FaultyInputError],
    *,
    faults: Iterable[Fault] = (),
    place: str = "",
) -> AnyPart:
    """Check what is at a place of a file, some faults of which are known; raise an error with all."""
    part = None
    try:
        part = kind.model_validate(data)
    except ValidationError as found:
        faults = [*faults, *faults_of(found)]
    if part is None or faults:
        raise error(str(source), [fault.below(place) for fault in faults])
    return part


def faults_of_named(place: str, name: str, error: OSError | FaultyInputError) -> list[Fault]:
    """Give the faults of a file that is named at a place of another one."""
    if isinstance(error, OSError):
        return [Fault(place, name, f"must be the name of a file that can be read ({error.strerror})")]
    return [fault.below(f"{place} ({name})") for fault in error.faults]


def fields_of(kind: type, names: Iterable[str]) -> dict[str, Any]:
    """Give some fields of a dataclass as `pydantic.create_model` takes them; one with a factory is required."""
    hints, known = get_type_hints(kind, include_extras=True), {each.name: each.default for each in fields(kind)}
    return {name: (hints[name], ... if known[name] is NO_DEFAULT else known[name]) for name in names}


def variant(name: str) -> str:
    """Name the case `name` of a union, so that it can be told from a key in the location of an error."""
    return f"({name})"


def _path(location: Location) -> str:
    path = ""
    for step in location:
        if isinstance(step, int):
            path += f"[{step}]"
        elif step.startswith("(") and step.endswith(")"):
            continue  # the case of a union, not a key
        else:
            path += f".{step}" if path else step
    return path


def _without_arrays(data: Any) -> Any:
    """Turn arrays, data frames and lists of arrays into lists without importing numpy or pandas."""
    return {key: _listed(value) for key, value in data.items()} if isinstance(data, Mapping) else data


def _listed(value: Any) -> Any:
    if hasattr(value, "to_numpy"):
        value = value.to_numpy()
    if isinstance(value, list) and value and hasattr(value[0], "tolist"):
        return [_listed(each) for each in value]
    return value.tolist() if hasattr(value, "tolist") else value


def wrong(message: str) -> PydanticCustomError:
    """Give the error that a validator raises for a value."""
    # The message is an argument of its template: it may hold braces of its own.
    return PydanticCustomError(_FAULT, "{message}", {"message": message})


def _details(location: Location, value: object, message: str) -> InitErrorDetails:
    return InitErrorDetails(type=wrong(message), loc=location, input=value)


def unknown_key(name: object, value: object, known: Iterable[str]) -> Fault:
    """Give the fault of a key that there is not, with the nearest one that is."""
    near = nearest(name, known)
    message = f"unknown key; did you mean {near!r}?" if near else "unknown key"
    return Fault(str(name), value, f"{message} (known here: {', '.join(known)})")


def _in_our_words(part: type[Part], error: ValidationError) -> list[InitErrorDetails]:
    """Say what pydantic found: the value, and what is allowed; a misspelt key is one fault, not two."""
    found = error.errors(include_url=False)
    keys = {key_of(part, name): field.description for name, field in part.model_fields.items()}
    misspelt = {e["loc"][0]: nearest(e["loc"][0], keys) for e in found if _is_unknown_key(e)}
    details: list[InitErrorDetails] = []
    for e in found:
        location, value, kind, context = e["loc"], e["input"], e["type"], e.get("ctx", {})
        if kind == _FAULT:
            message = e["msg"]
        elif _is_unknown_key(e):
            message = unknown_key(location[0], value, keys).message
        elif kind == "missing" and isinstance(location[-1], str):
            if location[0] in misspelt.values():
                continue
            value, message = MISSING, "missing; it is required" + _meaning(keys.get(str(location[0])))
        elif kind == "missing":  # a tuple of fixed length that ends too early
            least = int(location[-1]) + 1
            location = location[:-1]
            if details and details[-1]["loc"] == location:
                del details[-1]  # said of the entry before
            message = f"too short: must have at least {least} entries"
        else:
            said = _MESSAGES.get(kind, "{msg}").format(msg=e["msg"], **context)
            message = said + _meaning(keys.get(str(location[0]) if location else ""))
        details.append(_details(location, value, message))
    return details


_MESSAGES = {
    "float_type": "must be a number",
    "float_parsing": "must be a number",
    "finite_number": "must be a finite number",
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "greater_than": "must be greater than {gt:g}",
    "greater_than_equal": "must be at least {ge:g}",
    "less_than": "must be less than {lt:g}",
    "less_than_equal": "must be at most {le:g}",
    "string_type": "must be text; quote it",
    "string_too_short": "must not be empty",
    "string_unicode": "must be text without lone surrogates",
    "tuple_type": "must be a list",
    "too_long": "too long: must have at most {max_length} entries",
    "too_short": "too short: must have at least {min_length} entries",
    "enum": "must be one of {expected}",
    "literal_error": "must be {expected}",
    "none_required": "must be null in this version",
    "model_type": "must be a mapping of keys to values",
    "model_attributes_type": "must be a mapping of keys to values",
    "dataclass_type": "must be a mapping of keys to values",
    "unexpected_keyword_argument": "unknown key",
    "bool_type": "must be true or false",
    "invalid_key": "keys must be text",
}


def _is_unknown_key(error: Mapping[str, Any]) -> bool:
    return error["type"] == "extra_forbidden" and len(error["loc"]) == 1


def _meaning(description: str | None) -> str:
    return f" ({description})" if description else ""


def _salvage(part: type[Part], data: Any) -> Salvage:
    """Validate each field by itself, and keep what is valid."""
    if not isinstance(data, Mapping):
        return Salvage({})
    values: dict[str, Any] = {}
    for name, field in part.model_fields.items():
        key = key_of(part, name) if key_of(part, name) in data else name
        if key not in data:
            if not field.is_required():
                values[name] = field.get_default(call_default_factory=True)
            continue
        try:
            values[name] = _adapter(part, name).validate_python(_without_arrays({key: data[key]})[key])
        except ValidationError:
            nested = _part_in(field.annotation)
            if nested is None:
                continue
            if get_origin(field.annotation) is not tuple:
                values[name] = _salvage(nested, data[key])
            elif isinstance(data[key], (list, tuple)):
                values[name] = tuple(_valid_or_salvage(nested, item) for item in data[key])
    return Salvage(values)


def _valid_or_salvage(part: type[Part], data: Any) -> Part | Salvage:
    try:
        return part.model_validate(data)
    except ValidationError:
        return _salvage(part, data)


@lru_cache(maxsize=256)
def _adapter(part: type[Part], name: str) -> TypeAdapter[Any]:
    return TypeAdapter(get_type_hints(part, include_extras=True)[name])


def _part_in(annotation: Any) -> type[Part] | None:
    """Find the part class in `Vehicle`, `Motion | None` or `tuple[Obstacle, ...]`; None if several."""
    classes = [annotation, *get_args(annotation)]
    found = [c for c in classes if isinstance(c, type) and issubclass(c, Part)]
    return found[0] if len(found) == 1 else None
