"""Search, reading and one-line errors of TOML files."""

import contextlib
import difflib
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from coilarray.compute.files import text_of_file
from coilarray.design.keys import tags_of
from coilarray.errors import CoilarrayError, shown

_LONGEST_NAME = 200  # characters shown of a file name
_LONGEST_KEY = 120
_MOST_BYTES = 10_000_000
_DEEPEST = 100  # tables and lists in each other
_MOST_BITS = 1024  # of an integer. A larger integer is too large for a float as well

_Model = TypeVar("_Model", bound=BaseModel)


@dataclass(frozen=True)
class TomlFiles:
    """One kind of TOML file, such as designs, with bundled files in `package` if any."""

    kind: str
    error: type[CoilarrayError]
    package: str = ""

    def names(self) -> tuple[str, ...]:
        """Names of the files in the package, sorted."""
        found = (entry.name for entry in resources.files(self.package).iterdir()) if self.package else ()
        return tuple(sorted(name.removesuffix(".toml") for name in found if name.endswith(".toml")))

    def read(self, name: str) -> str:
        """Text of a file in the package."""
        if name not in self.names():
            raise KeyError(name)
        return resources.files(self.package).joinpath(f"{name}.toml").read_text(encoding="utf-8")

    def text(self, name_or_path: str | Path) -> str:
        """Text of a file, or else of a bundled file."""
        given = str(name_or_path)
        cut = given[:_LONGEST_NAME]
        if not given:
            raise self.error(f"the name of a {self.kind} file must not be empty.")
        path = Path(given)
        if given in self.names() and not path.is_file():
            return self.read(given)
        try:
            return text_of_file(path, _MOST_BYTES)
        except FileNotFoundError:
            bundled = f", nor a bundled {self.kind} of that name ({', '.join(self.names())})" if self.package else ""
            known = {name: name for name in self.names()}
            with contextlib.suppress(OSError, ValueError):  # a folder that cannot be read, or an impossible name
                known |= {entry.stem: str(path.with_name(entry.name)) for entry in path.parent.glob("*.toml")}
            close = [known[name] for name in difflib.get_close_matches(path.name.removesuffix(".toml"), known)]
            hint = f"; did you mean {close[0][:_LONGEST_NAME]}?" if close else "."
            raise self.error(f"there is no {self.kind} file {cut}{bundled}{hint}") from None
        except UnicodeDecodeError:
            raise self.error(f"{cut} is not a text file in UTF-8.") from None
        except OSError as error:
            raise self.error(f"cannot read {cut}: {error.strerror}.") from None
        except ValueError as error:  # a name with a zero byte
            raise self.error(f"cannot read {cut!r}: {error}.") from None

    def parse(self, text: str, origin: str) -> dict[str, Any]:
        """Return the tables of a file named `origin` in messages."""
        try:
            tables = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise self.error(f"{origin[:_LONGEST_NAME]}: not valid TOML: {error}.") from None
        except ValueError:  # Python's own limit, of 4300 digits
            raise self.error(f"{origin[:_LONGEST_NAME]}: not valid TOML: a number of thousands of digits.") from None
        except RecursionError:
            raise self.error(f"{origin[:_LONGEST_NAME]}: not valid TOML: nested too deeply.") from None
        if wrong := _unusable(tables):
            raise self.error(f"{origin[:_LONGEST_NAME]}: {wrong}")
        return tables

    def check(self, model: type[_Model], document: Mapping[str, Any], origin: str) -> _Model:
        """Check the tables of a file and return a model."""
        try:
            return model.model_validate(document)
        except ValidationError as error:
            message = first_error(error, document, model)
            whole = f"the {self.kind}" if message.startswith(" ") else ""  # a mistake that concerns no single key
            raise self.error(f"{origin[:_LONGEST_NAME]}: {whole}{message}") from None


def _unusable(tables: dict[str, Any]) -> str:
    """Describe nesting too deep, or an integer too long."""
    level: list[tuple[str, Any]] = [("", tables)]
    for _ in range(_DEEPEST):
        below: list[tuple[str, Any]] = []
        for key, value in level:
            if isinstance(value, int) and abs(value).bit_length() > _MOST_BITS:
                return f"{key[:_LONGEST_KEY]} must be a number of at most {_MOST_BITS} bits."
            if isinstance(value, dict):
                below += ((f"{key}.{name}" if key else name, one) for name, one in value.items())
            elif isinstance(value, list):
                below += ((f"{key}.{number}", one) for number, one in enumerate(value))
        if not below:
            return ""
        level = below
    return f"{level[0][0][:_LONGEST_KEY]} is nested too deeply."


def first_error(error: ValidationError, document: Mapping[str, Any], model: type[BaseModel] = BaseModel) -> str:
    """Describe the first mistake of a document with its key."""
    errors = error.errors(include_url=False)
    more = "" if len(errors) == 1 else f" (and {len(errors) - 1} more)"
    return f"{_describe(errors[0], document, model)}{more}"


def _describe(details: ErrorDetails, document: Mapping[str, Any], model: type[BaseModel]) -> str:
    where: list[str | int] = []
    table: Any = document
    tagged: Any = None
    for part in details["loc"]:
        if part == "[key]":  # the key itself is wrong, not its value
            continue
        # pydantic adds the tag of a union's member before its key of perhaps the same name.
        if isinstance(table, Mapping) and table is not tagged and part in (table.get("shape"), table.get("lattice")):
            tagged = table
            continue
        if part in ("number", "list") and not (isinstance(table, Mapping) and part in table):
            continue
        where.append(part)
        try:
            table = table[part]
        except (KeyError, IndexError, TypeError):
            table = None
    key = ".".join(str(part) for part in where)[:_LONGEST_KEY]
    kind, got = details["type"], details.get("input")
    if kind == "unknown_key":
        return f"{key or 'the file'} {details['msg']}."
    if kind == "missing":
        return f"{key} is missing."
    if kind in ("union_tag_not_found", "union_tag_invalid"):
        tag = str(details["ctx"]["discriminator"]).strip("'")
        *most, last = map(repr, tags_of(model, str(where[0]), tag))
        allowed = f"{', '.join(most)} or {last}"
        value = got.get(tag) if isinstance(got, Mapping) else None
        return f"{key}.{tag} must be {allowed}; got {'nothing' if value is None else shown(value)}."
    if kind == "value_error":
        words = details["msg"].removeprefix("Value error, ")
        return f"{key} {words}{'' if words.endswith('?') else '.'}"
    if kind == "string_pattern_mismatch":
        return f"{key} may have letters, digits, _ . + and, not first, -; got {shown(got)}."
    limits = details.get("ctx", {})
    least = limits.get("min_length")
    wanted = {
        "too_short": f"have at least {least} {'entry' if least == 1 else 'entries'}",
        "too_long": f"have at most {limits.get('max_length')} entries",
        "string_too_short": "not be empty",
        "greater_than": f"be greater than {limits.get('gt', 0):g}",
        "greater_than_equal": f"be at least {limits.get('ge', 0):g}",
        "less_than_equal": f"be at most {limits.get('le', 0):g}",
        "less_than": f"be less than {limits.get('lt', 0):g}",
        "finite_number": "be a finite number",
        "float_type": "be a number",
        "int_type": "be a whole number",
        "bool_type": "be true or false",
        "string_type": "be a text",
        "list_type": "be a list",
        "model_type": "be a table",
        "model_attributes_type": "be a table",
        "dict_type": "be a table",
        "literal_error": f"be {limits.get('expected')}",
    }.get(kind, details["msg"].removeprefix("Input should ").removeprefix("Value error, "))
    return f"{key or 'the file'} must {wanted}; got {shown(got)}."
