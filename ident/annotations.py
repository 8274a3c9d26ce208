"""Values held against annotations: arguments of public functions, and fields of data classes."""

import types
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import wraps
from inspect import Parameter, signature
from numbers import Integral, Real
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

import numpy as np

from ident.arguments import described
from ident.errors import InputError

WORDS: Mapping[str, str] = {
    "bool": "True or False",
    "int": "a whole number",
    "float": "a finite number",
    "str": "a text",
    "ndarray": "an array of real numbers",
    "NoneType": "None",
    "Path": "a path",
    "PathLike": "a path",
    "Sequence": "a list",
    "list": "a list",
    "Iterable": "a list",
    "Collection": "a list",
    "tuple": "a list",
    "Mapping": "a mapping",
    "dict": "a mapping",
    "Estimate": "an Estimate, as of mc.identify",
    "Mechanism": 'a Mechanism, such as mc.mechanism("arm.xml")',
    "MjSpec": 'an MjSpec, such as mc.scenes.load("double_pendulum")',
}
"""Types in words, by their names."""


@dataclass(frozen=True)
class Needs:
    """Condition on a value in its annotation, `Annotated[float, Needs("a number above 0", lambda x: x > 0)]`.

    Attributes:
        words: What is needed, for messages.
        holds: True if a value of the annotated type does.
    """

    words: str
    holds: Callable[[Any], bool]


def one_of(choices: Collection[str]) -> Needs:
    """Condition that a text is one of the choices."""
    return Needs(f"one of {', '.join(choices) or 'none'}", lambda x: x in choices)


Positive = Annotated[float, Needs("a number above 0", lambda x: x > 0)]
NotNegative = Annotated[float, Needs("a number of at least 0", lambda x: x >= 0)]
Point = tuple[float, float, float]
Vector = Annotated[np.ndarray, Needs("a list of 3 numbers", lambda x: np.shape(x) == (3,))]
"""Numbers, and three of them as a tuple or an array."""

F = TypeVar("F", bound=Callable[..., Any])


def typed(*but: str) -> Callable[[F], F]:
    """Decorator of public functions, and of classes for their `__init__`, that checks arguments by their annotations.

    Arguments that do not fit raise an InputError in one sentence. Numbers have to be finite. Lists that fit an array or
    a tuple are given on as one.

    Args:
        but: Parameters on which the function has a better sentence itself.
    """

    def decorate(function: Any) -> Any:
        if isinstance(function, type):
            function.__init__ = decorate(function.__init__)  # type: ignore[misc]
            return function
        own, hints = signature(function), dict[str, Any]()

        @wraps(function)
        def checked(*args: Any, **kwargs: Any) -> Any:
            if not hints:
                hints.update({name: _resolved(x.annotation, function) for name, x in own.parameters.items()})
                hints.update(dict.fromkeys(but, Any))
            try:
                given = own.bind(*args, **kwargs)
            except TypeError:
                return function(*args, **kwargs)
            for name, value in given.arguments.items():
                given.arguments[name] = _checked(name, value, hints[name])
            return function(*given.args, **given.kwargs)

        return checked

    return decorate


def misfit(kind: Any, own: Mapping[str, Any]) -> str:
    """The first field of a data class or named tuple whose value does not fit, in words; empty if all do."""
    hints = {name: x for each in reversed(kind.__mro__) for name, x in vars(each).get("__annotations__", {}).items()}
    for name, value in own.items():
        hint = hints[name]
        if not fits(value, hint):
            # Not the value itself: repeated parts of a list can make it endless.
            return f"{name} needs {in_words(hint)}, got one of type {type(value).__name__}"
    return ""


def fits(value: Any, hint: Any, *, exact: bool = True) -> bool:
    """True if a value is of an annotated type, or of one that cannot be checked, such as a protocol.

    Args:
        value: The value.
        hint: The annotation.
        exact: False to let lists pass for arrays and tuples, and arrays for lists.
    """
    if isinstance(hint, str | TypeVar) or hint is Any or getattr(hint, "_is_protocol", False):
        return True
    origin, args = get_origin(hint) or hint, get_args(hint)
    if origin in (Union, types.UnionType):
        return any(fits(value, each, exact=exact) for each in args)
    if origin is Literal:
        return value in args
    if origin is Annotated:
        return fits(value, args[0], exact=exact) and args[1].holds(value)
    if origin in _SCALARS:
        return _SCALARS[origin](value)
    if origin is np.ndarray:
        return (isinstance(value, np.ndarray) or not exact) and as_array(value) is not None
    if not isinstance(origin, type):
        return True
    if not exact and isinstance(value, np.ndarray) and issubclass(origin, Collection):
        return value.ndim == 1 and fits(value.tolist(), hint, exact=exact)
    if origin is tuple and isinstance(value, list) and not exact:
        value = tuple(value)
    # A text is a list of letters, but none is meant.
    if not isinstance(value, origin) or (isinstance(value, str) and origin is not str):
        return False
    return _parts_fit(value, origin, args, exact)


def _parts_fit(value: Any, origin: type, args: tuple[Any, ...], exact: bool) -> bool:
    """True if the entries of a collection fit the arguments of its type."""
    if not args or not isinstance(value, Collection) or origin.__module__ not in ("builtins", "collections.abc"):
        return True
    if isinstance(value, Mapping):
        both = (pair for item in value.items() for pair in zip(item, args, strict=True))
        return len(args) == 2 and all(fits(*each, exact=exact) for each in both)
    if origin is tuple and args[-1] is not Ellipsis:
        return len(value) == len(args) and all(fits(*each, exact=exact) for each in zip(value, args, strict=True))
    return all(fits(each, args[0], exact=exact) for each in value)


_SCALARS: Mapping[Any, Callable[[Any], bool]] = {
    bool: lambda value: isinstance(value, bool | np.bool_),
    int: lambda value: isinstance(value, Integral) and not isinstance(value, bool),
    float: lambda value: isinstance(value, Real) and not isinstance(value, bool),
}


def _checked(name: str, value: Any, hint: Any) -> Any:
    """The value, as an array or a tuple if it only fits as one."""
    # Infinite numbers are no lengths, rates or levels, and NaN is no answer to anything.
    infinite = hint is not Any and isinstance(value, float | np.floating) and not np.isfinite(value)
    if infinite or not fits(value, hint, exact=False):
        raise InputError(f"{name} needs {in_words(hint)}; got {described(value)}.")
    if fits(value, hint):
        return value
    arms = get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)
    if np.ndarray in arms:
        return as_array(value)
    return tuple(value) if isinstance(value, list) and any(get_origin(each) is tuple for each in arms) else value


def as_array(value: Any) -> np.ndarray | None:
    """Array of what numpy reads as real numbers or as symbols; None for anything else."""
    if not isinstance(value, np.ndarray | Collection) or isinstance(value, str | Mapping):
        return None
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):
        return None
    symbols = array.dtype.kind == "O" and not any(isinstance(x, str | complex | Collection | None) for x in array.flat)
    return array if symbols or array.dtype.kind in "biuf" else None


def in_words(hint: Any, *, several: bool = False) -> str:
    """Words for the values that an annotation admits, in the singular or in the plural."""
    origin, args = get_origin(hint) or hint, get_args(hint)
    if origin in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(in_words(each, several=several) for each in args))
    if origin is Annotated:
        return f"{'entries, each ' * several}{args[1].words}"
    if origin is tuple and args and args[-1] is not Ellipsis:
        return f"{'tuples' if several else 'a tuple'} ({', '.join(map(in_words, args))})"
    name = getattr(origin, "__name__", str(origin))
    if name not in WORDS:
        return f"{name} objects" if several else f"{'an' if name[0] in 'AEIOU' or name[:2] == 'Mj' else 'a'} {name}"
    words = WORDS[name]
    if several:
        head, *more = words.removeprefix("a ").removeprefix("an ").split(" of ", 1)
        words = " of ".join([head if name in ("bool", "NoneType") else f"{head}s", *more])
    # Of a mapping the values, of a list its entries.
    of = args[-1:] if name in ("Mapping", "dict") else args[:1]
    return words + "".join(f" of {in_words(each, several=True)}" for each in of)


def _resolved(hint: Any, function: Callable[..., Any]) -> Any:
    """An annotation, of which quoted ones are looked up among the names of the function's module."""
    if not isinstance(hint, str):
        return Any if hint is Parameter.empty else hint
    return function.__globals__.get(hint, Any)
