"""Names of methods: built-in ones, `@register`ed ones and those of installed packages; loaded lazily.

A file of this package needs no more than `@register("name")` right above its class; another package an entry point in
the group `bench.methods`.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

from envs.plugins import DuplicateNameError, UnavailableError, load, origins
from envs.scenario import UnknownNameError

if TYPE_CHECKING:
    from algorithms.method import Method

ENTRY_POINT_GROUP: Final = "bench.methods"

_BUILT_IN: Final[dict[str, str]] = {
    "dd-rq": "algorithms.dd_rq:DDRQ",
    "dd-rq-plus": "algorithms.dd_rq_plus:DDRQPlus",
    "safety-guard": "algorithms.dd_rq:FixedGuard",
    "sac": "algorithms.sac:SAC",
    "cpo": "algorithms.omnisafe_methods:CPO",
    "focops": "algorithms.omnisafe_methods:FOCOPS",
    "trpo-lag": "algorithms.omnisafe_methods:TRPOLag",
    "omnisafe": "algorithms.omnisafe_methods:OmniSafe",
    "constant-speed": "algorithms.reference_drivers:ConstantSpeed",
    "constant-speed+guard": "algorithms.reference_drivers:ConstantSpeedGuarded",
    "cruise+guard": "algorithms.reference_drivers:CruiseGuarded",
    "random+guard": "algorithms.reference_drivers:RandomGuarded",
    "cruise": "algorithms.reference_drivers:Cruise",
    "random": "algorithms.reference_drivers:Random",
    "idm": "algorithms.reference_drivers:IDM",
    "rss-guard": "algorithms.rss_method:RSSGuarded",
}
PAPER_METHODS: Final = ("dd-rq", "safety-guard", "sac", "cpo", "focops", "trpo-lag")
REFERENCE_DRIVERS: Final = (
    "constant-speed",
    "constant-speed+guard",
    "cruise",
    "cruise+guard",
    "idm",
    "random",
    "random+guard",
    "rss-guard",
)
"""Rows that make a table's figures readable; all but `rss-guard` are scripted."""

_REGISTERS: Final = re.compile(r'^@register\("([^"]+)"\)\nclass (\w+)', re.MULTILINE)

M = TypeVar("M", bound="type[Method]")
_registered: dict[str, tuple[str, type[Method]]] = {}


class UnavailableMethodError(UnavailableError):
    """A known method cannot be used here; the message says why and what helps."""


@dataclass(frozen=True, slots=True)
class Listing:
    """One known method: whether it can be used, why not, and where it comes from."""

    name: str
    available: bool
    reason: str
    origin: str


def register(name: str) -> Callable[[M], M]:
    """Class decorator that makes a method known under a name, from the moment that its module is imported.

    Raises:
        DuplicateNameError: The name is taken; both origins are named.
    """

    def decorate(method: M) -> M:
        origin = f"{method.__module__}:{method.__qualname__}"
        taken = [claim for claim in _origins().get(name, []) if claim != origin]
        if taken:
            raise DuplicateNameError("Method", name, [*taken, origin])
        method.name = name
        _registered[name] = (origin, method)
        return method

    return decorate


@functools.cache
def _in_files() -> dict[str, str]:
    """Origin by name of what files of this package register; read from their text, nothing is imported."""
    found = {}
    for path in sorted(Path(__file__).parent.glob("*.py")):
        for name, attribute in _REGISTERS.findall(path.read_text("utf-8")):
            found[name] = f"algorithms.{path.stem}:{attribute}"
    return found


def _origins() -> dict[str, list[str]]:
    known = origins(ENTRY_POINT_GROUP, {**_in_files(), **_BUILT_IN})
    for name, (origin, _) in _registered.items():
        claims = known.setdefault(name, [])
        if origin not in claims:
            claims.append(origin)
    return known


def method_names() -> list[str]:
    """Every known name, available or not."""
    return sorted(_origins())


def _load_class(name: str) -> type[Method]:
    known = _origins()
    if name not in known:
        raise UnknownNameError("method", name, sorted(known))
    if len(known[name]) > 1:
        raise DuplicateNameError("Method", name, known[name])
    if name in _registered:
        return _registered[name][1]
    (origin,) = known[name]
    loaded: type[Method] = load(origin)
    try:
        loaded.check_available()
    except UnavailableError:
        raise
    except Exception as error:  # a plugin may raise anything; it must hide no other method
        raise UnavailableMethodError(f"{origin} failed to load: {type(error).__name__}: {error}") from error
    loaded.name = name
    return loaded


def _parse(text: str, default: Any, where: str) -> Any:
    if isinstance(default, bool):
        if text.lower() not in ("true", "false"):
            raise ValueError(f"{where} = {text!r}: expected true or false.")
        return text.lower() == "true"
    try:
        return type(default)(text)
    except ValueError:
        raise ValueError(f"{where} = {text!r}: expected {type(default).__name__}.") from None


def get_method(spec: str) -> Method:
    """The method of a name, parameters after a colon: ``safety-guard:tc=5.0``.

    Raises:
        UnknownNameError: The method or a parameter is unknown.
        UnavailableError: It is known, but cannot be used here, or several packages claim the name.
        ValueError: A parameter's value is malformed or out of range.
    """
    name, _, tail = spec.partition(":")
    loaded = _load_class(name)
    parameters: dict[str, Any] = {}
    for item in filter(None, tail.split(",")):
        key, _, text = item.partition("=")
        if key not in loaded.defaults:
            raise UnknownNameError(f"parameter of {name}", key, sorted(loaded.defaults))
        parameters[key] = _parse(text, loaded.defaults[key], f"{name}:{key}")
    return loaded(**parameters)


def list_methods() -> list[Listing]:
    """All known methods, in order of name; a broken one is listed with its reason."""
    listings = []
    for name, claims in sorted(_origins().items()):
        origin = ", ".join(claims)
        try:
            _load_class(name)
            listings.append(Listing(name, True, "", origin))
        except UnavailableError as error:
            listings.append(Listing(name, False, str(error), origin))
    return listings
