"""What MkDocs does with this project's pages besides its plugins.

Tables of the scenario file are made from its JSON schema; roles of Sphinx in docstrings become plain code. Pages that
the navigation does not name are appended to their folder's section, and public names that the reference does not name
to a page of it. The search works on pages that are read from files, without a server. Formulas, in a little of TeX, are
made into MathML, which browsers set by themselves, without script or network; what is not known is refused.
"""

from __future__ import annotations

import json
import re
from functools import cache
from html import escape
from pathlib import Path
from typing import Any

import scp_planner
from scp_planner import Scenario

TABLES = "<!-- tables of the scenario file -->"
NAMES = {"number": "number", "integer": "whole number", "string": "text", "boolean": "true or false", "null": "null"}


SECTIONS = {"howto": "How-to", "explanation": "Explanation", "reference": "Reference"}
REFERENCE = Path(__file__).parent / "reference"
FILE_WORKER = Path(__file__).parent / "assets" / "file-worker.js"
NAMED = re.compile(r"^::: (\S+)$", re.M)
ROLE = re.compile(r":(?:attr|class|data|func|meth|mod):(?=<code>)")

GREEK = dict(
    zip("beta gamma theta lambda mu nu pi rho sigma tau omega eta Gamma Sigma".split(), "βγθλμνπρστωηΓΣ", strict=True)
)
OPERATORS = {
    "sum": "∑",
    "int": "∫",
    "le": "≤",
    "ge": "≥",
    "cdot": "·",
    "in": "∈",
    "infty": "∞",
    "quad": "",
}
FUNCTIONS = {"log", "exp", "max", "min", "sin", "cos"}
UNDER = {"\\sum", "\\max", "\\min"}
"""What has its index below it."""

TOKEN = re.compile(r"\\[A-Za-z]+|\\\\|\\[,{}]|\d+(?:\.\d+)?|\S")
TEXT = re.compile(r"\\text\{([^{}]*)\}")
INDEX = re.compile(r"(?<![\w/.])([^\W\d_]\u0302?)_(max|min|[A-Za-z0-9])(?:\^([A-Za-z0-9]))?(?![\w^])")
"""A single letter with an index, as it is written within a sentence."""


def on_config(config: Any) -> Any:
    """Name pages in the navigation that nobody has named there, and say how formulas are set."""
    fence = {"name": "math", "class": "formula", "format": fenced}
    config.mdx_configs.setdefault("pymdownx.superfences", {})["custom_fences"] = [fence]
    named = set(_pages(config.nav))
    for folder, title in SECTIONS.items():
        section = next(entry[title] for entry in config.nav if title in entry)
        for page in sorted((Path(config.docs_dir) / folder).glob("*.md")):
            name = f"{folder}/{page.name}"
            if name not in named:
                section.append(name)
    return config


def _pages(nav: Any) -> list[str]:
    if isinstance(nav, str):
        return [nav]
    return [page for part in (nav.values() if isinstance(nav, dict) else nav) for page in _pages(part)]


def on_page_content(html: str, **_: Any) -> str:
    """Take the marks of roles away, and set letters with an index."""
    return with_indices(ROLE.sub("", html))


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Put the tables where a page wants them, and public names that no page has where their neighbours are."""
    if page.file.src_uri.startswith("reference/"):
        markdown += "".join(f"\n::: {path}\n" for path in unnamed().get(page.file.name, []))
    return markdown.replace(TABLES, tables()) if TABLES in markdown else markdown


def on_post_page(output: str, **_: Any) -> str:
    """Let the search work on pages that are read from files, too."""
    return output.replace("</head>", f"<script>{FILE_WORKER.read_text(encoding='utf-8')}</script></head>", 1)


def on_post_build(config: Any) -> None:
    """Put what is searched where a page that is read from a file finds it: in a script."""
    folder = Path(config.site_dir) / "search"
    index = (folder / "search_index.json").read_text(encoding="utf-8")
    (folder / "search_index.js").write_text(f"var __index = {index}", encoding="utf-8")


@cache
def unnamed() -> dict[str, list[str]]:
    """Give the public names that no page of the reference has, by the page that has others of their module."""
    pages = {page.stem: NAMED.findall(page.read_text(encoding="utf-8")) for page in REFERENCE.glob("*.md")}
    known = {path: stem for stem, paths in pages.items() for path in paths}
    home = {path.rpartition(".")[0]: stem for path, stem in known.items()}
    found: dict[str, list[str]] = {}
    for name in scp_planner.__all__:
        value = getattr(scp_planner, name)
        path = f"{getattr(value, '__module__', '')}.{name}"
        if not name.startswith("_") and path not in known:
            found.setdefault(home.get(path.rpartition(".")[0], "plan"), []).append(path)
    return found


def tables() -> str:
    """Give a table of keys for the scenario and for each of its parts."""
    schema = Scenario.json_schema()
    parts = {name: part for name, part in schema["$defs"].items() if "properties" in part}
    order = ["Scenario", *_in_order(schema, parts, [])]
    sections = [_section(name, schema if name == "Scenario" else parts[name], parts) for name in order]
    return "\n\n".join(sections)


def _in_order(schema: Any, parts: dict[str, Any], found: list[str]) -> list[str]:
    """Names of the parts, each after the first one that has it."""
    if isinstance(schema, dict):
        name = str(schema.get("$ref", "")).rpartition("/")[2]
        if name in parts and name not in found:
            found.append(name)
            _in_order(parts[name].get("properties"), parts, found)
        for key, value in schema.items():
            if key != "$defs":
                _in_order(value, parts, found)
    elif isinstance(schema, list):
        for item in schema:
            _in_order(item, parts, found)
    return found


def _section(name: str, schema: dict[str, Any], parts: dict[str, Any]) -> str:
    required = schema.get("required", [])
    rows = [
        f"| `{key}` | {_kind(value, parts)} | {_default(key, value, required)} | {value.get('description', '')} |"
        for key, value in schema["properties"].items()
    ]
    text = " ".join(schema.get("description", "").split("\n\n")[0].split())
    lines = [f"## {name}", "", text, "", "| key | value | default | |", "| --- | --- | --- | --- |", *rows]
    return "\n".join(lines)


def _default(key: str, schema: dict[str, Any], required: list[str]) -> str:
    if key in required:
        return "required"
    default = schema.get("default")
    if isinstance(default, dict):
        return "its defaults"
    return f"`{json.dumps(default)}`" if default is not None else "null"


def _kind(schema: dict[str, Any], parts: dict[str, Any]) -> str:
    """Say in a few words what a value may be; parts are links to their tables."""
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        if name in parts:
            return f"[{name}](#{name.lower()})"
        return " or ".join(f"`{word}`" for word in Scenario.json_schema()["$defs"][name]["enum"])
    for key in ("anyOf", "oneOf", "allOf"):
        if key in schema:
            return " or ".join(dict.fromkeys(_kind(option, parts) for option in schema[key]))
    if "const" in schema:
        return f"`{schema['const']}`"
    if "enum" in schema:
        return " or ".join(f"`{word}`" for word in schema["enum"])
    if schema.get("type") == "array":
        if "prefixItems" in schema:
            return "[" + ", ".join(_kind(item, parts) for item in schema["prefixItems"]) + "]"
        return f"list of {_kind(schema.get('items', {}), parts)}"
    return f"{NAMES.get(schema.get('type', ''), 'object')}{_range(schema)}"


def _range(schema: dict[str, Any]) -> str:
    words = {"exclusiveMinimum": "> {}", "minimum": "≥ {}", "exclusiveMaximum": "< {}", "maximum": "≤ {}"}
    told = [text.format(schema[key]) for key, text in words.items() if key in schema and abs(schema[key]) < 1e12]
    return f" {', '.join(told)}" if told else ""


def to_mathml(source: str) -> str:
    """Set a formula; of an aligned one lines end with two backslashes, and `&` is where they are aligned.

    Raises
    ------
    ValueError
        If it has something that is not known here.
    """
    lines = re.sub(r"\\(?:begin|end)\{aligned\}", "", source).strip().split(r"\\")
    rows = ["".join(f"<mtd>{_Formula(cell).whole()}</mtd>" for cell in line.split("&")) for line in lines]
    body = "".join(f"<mtr>{row}</mtr>" for row in rows)
    return (
        '<math xmlns="http://www.w3.org/1998/Math/MathML" display="block">'
        f'<mtable displaystyle="true" columnalign="right left left" rowspacing="0.6em">{body}</mtable></math>'
    )


def fenced(source: str, *_: Any, **__: Any) -> str:
    """Set a fenced block of the pages."""
    return f'<div class="formula">{to_mathml(source)}</div>'


def with_indices(html: str) -> str:
    """Set letters with an index that stand in the text of a page, not in its code, scripts and formulas."""
    parts, inside = re.split(r"(<[^>]*>)", html), 0
    for k, part in enumerate(parts):
        tag = re.match(r"<(/?)(code|pre|script|style|math|svg)\b", part)
        if tag:
            inside += -1 if tag[1] else 1
        elif not part.startswith("<") and not inside:
            parts[k] = INDEX.sub(_set_index, part)
    return "".join(parts)


def _set_index(found: re.Match[str]) -> str:
    above = f"<sup>{found[3]}</sup>" if found[3] else ""
    return f"<i>{found[1]}</i><sub>{found[2]}</sub>{above}"


class _Formula:
    """One cell of a formula, read from left to right."""

    def __init__(self, source: str) -> None:
        self._texts = TEXT.findall(source)
        self._tokens = TOKEN.findall(TEXT.sub(r"\\text ", source))
        self._source = source
        self._texts.reverse()
        self._before = ""

    def whole(self) -> str:
        row = self._row()
        if self._tokens:
            raise ValueError(f"{self._source}: what is {self._tokens[0]!r}?")
        return row

    def _row(self) -> str:
        parts = []
        while self._tokens and self._tokens[0] not in ("}", "\\right"):
            parts.append(self._scripted())
        return f"<mrow>{''.join(parts)}</mrow>"

    def _scripted(self) -> str:
        first = self._tokens[0]
        base, marks = self._atom(), {}
        while self._tokens and self._tokens[0] in ("_", "^"):
            mark = self._tokens.pop(0)
            marks[mark] = self._atom()
        if not marks:
            return base
        below, above = ("under", "over") if first in UNDER else ("sub", "sup")
        kind = "m" + (below if "_" in marks else "") + (above if "^" in marks else "")
        return f"<{kind}>{base}{marks.get('_', '')}{marks.get('^', '')}</{kind}>"

    def _atom(self) -> str:
        if not self._tokens:
            raise ValueError(f"{self._source}: it ends too early")
        token, before = self._tokens.pop(0), self._before
        self._before = token
        if token == "{":
            row = self._row()
            self._expect("}")
            return row
        if token.startswith("\\"):
            return self._command(token[1:])
        if token[0].isdigit():
            return f"<mn>{token}</mn>"
        if token.isalpha():
            return f"<mi>{token}</mi>"
        if token in "+-=(),./|<>;:'!":
            sign = escape(token.replace("-", "\N{MINUS SIGN}"))
            form = ' form="prefix"' if token in "+-" and before in ("", "(", "{", "=", ",") else ""
            return f'<mo stretchy="false"{form}>{sign}</mo>'
        raise ValueError(f"{self._source}: what is {token!r}?")

    def _command(self, name: str) -> str:
        if name == "frac":
            return f"<mfrac>{self._atom()}{self._atom()}</mfrac>"
        if name == "sqrt":
            return f"<msqrt>{self._atom()}</msqrt>"
        if name == "text":
            return f"<mtext>{escape(self._texts.pop()).replace(' ', '&#160;')}</mtext>"
        if name == "left":
            return self._fence()
        if name in (",", "quad"):
            return f'<mspace width="{"0.2em" if name == "," else "1.5em"}"/>'
        if name in GREEK:
            return f"<mi>{GREEK[name]}</mi>"
        if name in OPERATORS:
            return f"<mo>{OPERATORS[name]}</mo>"
        if name in FUNCTIONS:
            return f"<mi>{name}</mi>"
        raise ValueError(f"{self._source}: what is \\{name}?")

    def _fence(self) -> str:
        opening = self._tokens.pop(0)
        row = self._row()
        self._expect("\\right")
        closing = self._tokens.pop(0)
        return f'<mrow><mo fence="true">{escape(opening)}</mo>{row}<mo fence="true">{escape(closing)}</mo></mrow>'

    def _expect(self, token: str) -> None:
        if not self._tokens or self._tokens.pop(0) != token:
            raise ValueError(f"{self._source}: {token} is missing")
