"""Values held against annotations: arguments of public functions, and fields of data classes."""

import types
from collections.abc import Callable, Collection, Mapping
from dataclasses import fields
from functools import wraps
from inspect import Parameter, signature
from numbers import Integral, Real
from typing import Any, Literal, TypeVar, Union, get_args, get_origin

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
    "Iterable": "a list",
    "Collection": "a list",
    "Estimate": "an Estimate, as of mc.identify",
    "Mechanism": 'a Mechanism, such as mc.mechanism("arm.xml")',
    "MjSpec": 'an MjSpec, such as mc.scenes.load("double_pendulum")',
}
"""Types in words, by their names."""

F = TypeVar("F", bound=Callable[..., Any])


def typed(*but: str) -> Callable[[F], F]:
    """Decorator of public functions, which then raise an InputError for arguments that do not fit their annotations.

    Numbers have to be finite. Lists that fit an array are given on as arrays.

    Args:
        but: Parameters on which the function has a better sentence itself.
    """

    def decorate(function: F) -> F:
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

        return checked  # type: ignore[return-value]

    return decorate


def check_fields(instance: Any, *but: str, error: type[InputError] = InputError) -> None:
    """Refuses a data class whose fields do not fit their annotations; lists that fit an array become one.

    Args:
        instance: The data class, in its `__post_init__`.
        but: Fields that are checked in another way.
        error: Type of the error to raise.
    """
    kind = type(instance)
    for each in fields(kind):
        if each.name not in but:
            value = getattr(instance, each.name)
            checked = _checked(f"{kind.__name__}.{each.name}", value, each.type, error)
            if checked is not value:
                object.__setattr__(instance, each.name, checked)


def misfit(kind: Any, own: Mapping[str, Any]) -> str:
    """The first field of a data class or named tuple whose value does not fit, in words; empty if all do."""
    for name, value in own.items():
        hint = kind.__annotations__[name]
        if not fits(value, hint):
            # Not the value itself: repeated parts of a list can make it endless.
            return f"{name} needs {in_words(hint)}, got one of type {type(value).__name__}"
    return ""


def fits(value: Any, hint: Any) -> bool:
    """True if a value is of an annotated type; True for types that cannot be checked, such as protocols."""
    if isinstance(hint, str | TypeVar) or hint is Any or getattr(hint, "_is_protocol", False):
        return True
    origin, args = get_origin(hint) or hint, get_args(hint)
    if origin in (Union, types.UnionType):
        return any(fits(value, each) for each in args)
    if origin is Literal:
        return value in args
    if origin in _SCALARS:
        return _SCALARS[origin](value)
    if not isinstance(origin, type):
        return callable(value) if origin is Callable else True
    if issubclass(origin, Collection) and origin is not tuple and isinstance(value, np.ndarray):
        return value.ndim == 1 and fits(value.tolist(), hint)
    if not isinstance(value, origin) or (isinstance(value, str) and origin is not str):
        return isinstance(value, str) and issubclass(origin, str)
    return _parts_fit(value, origin, args)


def _parts_fit(value: Any, origin: type, args: tuple[Any, ...]) -> bool:
    """True if the entries of a collection fit the arguments of its type."""
    if not args or not isinstance(value, Collection) or origin.__module__ not in ("builtins", "collections.abc"):
        return True
    if isinstance(value, Mapping):
        return all(fits(key, args[0]) and fits(each, args[1]) for key, each in value.items())
    if origin is tuple and args[-1] is not Ellipsis:
        return len(value) == len(args) and all(map(fits, value, args))
    return all(fits(each, args[0]) for each in value)


_SCALARS: Mapping[Any, Callable[[Any], bool]] = {
    bool: lambda value: isinstance(value, bool | np.bool_),
    int: lambda value: isinstance(value, Integral) and not isinstance(value, bool),
    float: lambda value: isinstance(value, Real) and not isinstance(value, bool),
    np.ndarray: lambda value: isinstance(value, np.ndarray) and as_array(value) is not None,
}


def _checked(name: str, value: Any, hint: Any, error: type[InputError] = InputError) -> Any:
    """The value, as an array if it only fits as one."""
    arms = get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)
    # Infinite numbers are no lengths, rates or levels; NaN is no answer to anything.
    if fits(value, hint) and not (isinstance(value, float | np.floating) and not np.isfinite(value)):
        return value
    if np.ndarray in arms and isinstance(value, Collection) and not isinstance(value, str | Mapping):
        array = as_array(value)
        if array is not None:
            return array
    raise error(f"{name} needs {in_words(hint)}; got {described(value)}.")


def as_array(value: Any) -> np.ndarray | None:
    """Array of what numpy reads as real numbers or as symbols; None for anything else."""
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):
        return None
    symbols = array.dtype.kind == "O" and all(hasattr(x, "free_symbols") or isinstance(x, Real) for x in array.flat)
    return array if symbols or array.dtype.kind in "biuf" else None


def in_words(hint: Any) -> str:
    """What an annotation asks for."""
    origin, args = get_origin(hint) or hint, get_args(hint)
    if origin in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(map(in_words, args)))
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return f"a mapping of names to {_plural(in_words(args[1]))}" if args else "a mapping"
    name = getattr(origin, "__name__", str(origin))
    inner = f" of {_plural(in_words(args[0]))}" if args and WORDS.get(name) == "a list" else ""
    return WORDS.get(name, f"{'an' if name[0] in 'AEIOU' else 'a'} {name}") + inner


def _plural(words: str) -> str:
    """`a text` as `texts`, `an array of real numbers` as `arrays of real numbers`."""
    head, *more = words.removeprefix("a ").removeprefix("an ").split(" of ", 1)
    return " of ".join([head if head.startswith(("True", "None")) else f"{head}s", *more])


def _resolved(hint: Any, function: Callable[..., Any]) -> Any:
    """An annotation, of which quoted ones are looked up among the names of the function's module."""
    if not isinstance(hint, str):
        return Any if hint is Parameter.empty else hint
    return function.__globals__.get(hint, Any)
