"""Names of methods: built-in ones, `@register`ed ones and those of installed packages; loaded lazily."""

from __future__ import annotations

import importlib
import importlib.metadata
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, TypeVar

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
    "rss-guard": "algorithms.rss_guard:RSSGuarded",
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

M = TypeVar("M", bound="type[Method]")
_registered: dict[str, tuple[str, type[Method]]] = {}


class UnavailableMethodError(RuntimeError):
    """A known method cannot be used here; the message says why and what helps."""


class DuplicateNameError(ValueError):
    """Two origins claim one name."""


@dataclass(frozen=True, slots=True)
class Listing:
    """One known method: whether it can be used, why not, and where it comes from."""

    name: str
    available: bool
    reason: str
    origin: str


def register(name: str) -> Callable[[M], M]:
    """Class decorator that makes a method known under a name.

    Raises:
        DuplicateNameError: The name is taken; both origins are named.
    """

    def decorate(method: M) -> M:
        origin = f"{method.__module__}:{method.__qualname__}"
        taken = _origins().get(name)
        if taken is not None and taken != origin:
            raise DuplicateNameError(f"Method name {name!r} is claimed by {taken} and by {origin}.")
        method.name = name
        _registered[name] = (origin, method)
        return method

    return decorate


def _entry_points() -> dict[str, importlib.metadata.EntryPoint]:
    found: dict[str, importlib.metadata.EntryPoint] = {}
    for point in importlib.metadata.entry_points(group=ENTRY_POINT_GROUP):
        other = _BUILT_IN.get(point.name) or (found[point.name].value if point.name in found else None)
        if other is not None and other != point.value:
            raise DuplicateNameError(f"Method name {point.name!r} is claimed by {other} and by {point.value}.")
        found[point.name] = point
    return found


def _origins() -> dict[str, str]:
    registered = {name: origin for name, (origin, _) in _registered.items()}
    return {**_BUILT_IN, **{name: point.value for name, point in _entry_points().items()}, **registered}


def method_names() -> list[str]:
    """Every known name, available or not."""
    return sorted(_origins())


def _load_class(name: str) -> type[Method]:
    origins = _origins()
    if name not in origins:
        raise UnknownNameError("method", name, sorted(origins))
    if name in _registered:
        return _registered[name][1]
    module, _, attribute = origins[name].partition(":")
    try:
        loaded: type[Method] = getattr(importlib.import_module(module), attribute)
        loaded.check_available()
    except UnavailableMethodError:
        raise
    except Exception as error:  # a plugin may raise anything; it must hide no other method
        raise UnavailableMethodError(f"{origins[name]} failed to load: {type(error).__name__}: {error}") from error
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
        UnavailableMethodError: It is known, but cannot be used here.
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
    for name, origin in sorted(_origins().items()):
        try:
            _load_class(name)
            listings.append(Listing(name, True, "", origin))
        except UnavailableMethodError as error:
            listings.append(Listing(name, False, str(error), origin))
    return listings
