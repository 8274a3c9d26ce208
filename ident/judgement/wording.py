"""Values of findings in words: formats of their templates, and what templates name beside values."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import degrees
from string import Formatter
from typing import Any

from ident.judgement.residuals import FAR_ABOVE
from ident.tolerances import NAMED

CANDIDATES = {"estimate": "the estimate", "model": "the model as it came", "least squares": "least squares"}
"""Candidates in words."""

LACKS = {
    "force": "a force on '{body}' that changes with its place (cable, spring)",
    "length": "another distance of the joint of '{body}' from the body that carries it",
}
"""Words for the forces and lengths that a model may lack, by kind."""


class InWords(Formatter):
    """Formats templates by what follows a value's colon; a value that is missing is none.

    `{joints:joints}` lists few names and counts others, `{joints:each}` names up to eight, `{joints:arguments}` all,
    for a command; `{ratios:channels .3g}` brackets each one's number; `{share:%}` is in per cent.
    `{log:?in log {log}|here}` is the text before the bar if there is such a value, and else that after it, if any;
    `{joints:1its|their}` that before the bar for a single one. What is no value is one of `WORDS`.
    """

    def get_value(self, key: int | str, args: Any, kwargs: Any) -> Any:
        """The value of a name, or the words for it; None if it has neither."""
        if key in WORDS and key not in kwargs:
            return WORDS[str(key)](**kwargs)
        return kwargs.get(key)

    def format_field(self, value: Any, format_spec: str) -> str:
        """A value in a format."""
        if format_spec[:1] in ("?", "1"):
            first = value if format_spec[0] == "?" else len(value) == 1
            return format_spec[1:].partition("|")[0 if first else 2]
        if value is None:
            return ""
        if isinstance(value, Mapping):
            what, _, form = format_spec.rpartition(" ")
            return bracketed({name: _read(own) for name, own in value.items()}, what, form)
        if not isinstance(value, list | tuple):
            return percent(value) if format_spec == "%" else format(value, format_spec)
        if format_spec == "arguments":
            return " ".join(own if isinstance(own, str) else f"{own:g}" for own in value)
        if not all(isinstance(own, str) for own in value):
            return listed(format(_read(own), format_spec) for own in value)
        return named(value) if format_spec == "each" else listed(value, format_spec)


def _read(number: Any) -> Any:
    """A number as it was before JSON, which has no NaN."""
    return float("nan") if number is None else number


def listed(names: Iterable[str], what: str = "") -> str:
    """Names with commas between them, or how many of `what` they are if more than `NAMED`.

    >>> listed("abc", "joints"), listed("abcde", "joints")
    ('a, b, c', '5 joints')
    """
    every = [*names]
    return f"{len(every)} {what}" if what and len(every) > NAMED else ", ".join(every)


def named(names: Sequence[str]) -> str:
    """Names with commas between them, the first eight of more, and the number of others.

    >>> named("abc"), named("abcdefghij")
    ('a, b, c', 'a, b, c, d, e, f, g, h and 2 others')
    """
    others = len(names) - 8
    return ", ".join(names[:8]) + (f" and {number_of(others, 'other')}" if others > 0 else "")


def bracketed(values: Mapping[str, float], what: str, form: str = ".3g") -> str:
    """Names with commas between them, each with its number in brackets, or how many and the range of their numbers.

    >>> bracketed({"a": 1.0, "b": 0.25}, "joints"), bracketed(dict(zip("abcde", range(5))), "joints")
    ('a (1), b (0.25)', '5 joints (0 to 4)')
    """
    if len(values) > NAMED:
        return f"{len(values)} {what} ({min(values.values()):{form}} to {max(values.values()):{form}})"
    return listed(f"{name} ({value:{form}})" for name, value in values.items())


def percent(share: float, digits: int = 0) -> str:
    """A share in per cent."""
    return f"{round(100 * share, digits) + 0.0:.{digits}f} %"


def number_of(number: int, noun: str) -> str:
    """A number with its noun, in the plural for all but one."""
    return f"{number} {noun}{'s' * (number != 1)}"


def worse_pairs(worse: Mapping[str, Mapping[str, Sequence[float]]], **_: Any) -> str:
    """Candidates that the estimate is worse than, with both ratios of the worst channel if there are many."""
    return ", and than ".join(f"{CANDIDATES[name]} in {_pairs(channels)}" for name, channels in worse.items())


def _pairs(channels: Mapping[str, Sequence[float]]) -> str:
    pairs = {channel: f"{channel} ({own:.3g} against {other:.3g})" for channel, (own, other) in channels.items()}
    most = max(channels, key=lambda channel: channels[channel][0] - channels[channel][1])
    return listed(pairs.values(), f"channels, most in {pairs[most]}")


def advice(worse: Mapping[str, Any], take: str, cutoff_hz: float | None, **_: Any) -> str:
    """Candidate to take instead of the estimate, or what to do first."""
    if take == "nothing":
        return "First mend the recording, as said above."
    if take == "model":
        return "Keep the model, or record more."
    if take == "least squares":
        return f"Take least squares, --estimator weighted{'' if cutoff_hz is None else f' --cutoff {cutoff_hz:.3g}'}."
    return (
        "Least squares had the model's bodies as a prior, without which --estimator weighted does not separate the "
        f"parameters. {'Keep the model, or move' if 'model' in worse else 'Move'} the joints further."
    )


def lead(candidate: str, behind: float, ratios: Mapping[str, Any], **_: Any) -> str:
    """Clause on a candidate that predicts better than the estimate, with the size of its lead."""
    name, by = CANDIDATES[candidate], percent(behind - 1)
    return f"{name[0].upper()}{name[1:]} predicts better than the estimate, by {by} in the median of {len(ratios)}"


def ending(status: str, rounds: int) -> str:
    """Clause on the end of a trajectory estimate that has not converged."""
    how = {"interrupted": "was interrupted", "stuck": "found no better step"}.get(status, "did not settle")
    return f"{how} after {number_of(rounds, 'round')}"


def distances(logs: Sequence[int], rms_z: Sequence[float], **_: Any) -> str:
    """Distances of logs from the others."""
    return bracketed({f"log {log}": z for log, z in zip(logs, rms_z, strict=True)}, "logs", ".1f")


def above_fast_noise(factors: Mapping[str, float], all_channels: bool) -> str:
    """Sentence on residuals over the fast noise."""
    times = {channel: "over 100" if factor > 100 else f"{factor:.0f}" for channel, factor in factors.items()}
    if all_channels:
        ends = dict.fromkeys(times[choose(factors, key=factors.__getitem__)] for choose in (min, max))
        return f"In all channels the residual is far above the fast noise of the sensors, {' to '.join(ends)} times."
    each = listed((f"{channel} {factor} times" for channel, factor in times.items()), "channels")
    return f"The residual is far above the fast noise of the sensors: {each}."


def in_each_log(values: Mapping[str, Sequence[float]]) -> str:
    """Values of parameters in each log."""
    return listed((f"{name} ({', '.join(f'{x:.2g}' for x in own)})" for name, own in values.items()), "of them")


def causes_in_words(causes: Sequence[Mapping[str, str]], **_: Any) -> str:
    """Sentences on forces and lengths that a model may lack."""
    return " Or it is ".join(f"{LACKS[cause['kind']].format(body=cause['body'])}." for cause in causes)


def lateness(of: str, delay: float, std: float, **_: Any) -> str:
    """Channels that are late, with the delay."""
    looks, how = "looks" if of == "wrench" else "look", "late behind" if delay > 0 else "early before"
    return f"{of} {looks} {1e3 * abs(delay):.0f} ± {1e3 * std:.0f} ms {how}"


def delay_stated(of: str, delay: float, **_: Any) -> str:
    """Advice on the columns file of late channels."""
    if of == "torques":
        return f"Log them in a file of their own, with constant = {-delay:.2g} for its times in the columns file"
    return f"Write delay = {abs(delay):.2g} under [setup] in the columns file, so that the estimate includes it"


def turned(opposite: bool, frame: str, axes: Mapping[str, str], **_: Any) -> str:
    """Sign and frame that a wrench seems to have."""
    frames = {
        "as stated": "",
        "transposed": "a transposed frame (its rotation is that of the base in the sensor)",
        "turned": f"a turned frame (axes {listed(f'{own} -> {other}' for own, other in axes.items())})",
    }
    return " and ".join(filter(None, ["the opposite sign" * opposite, frames[frame]]))


def steps_in_words(steps: Sequence[Mapping[str, Any]]) -> str:
    """Steps of columns with units, of joints in degrees or millimetres."""
    each = []
    for own in steps:
        name, step = own["name"], own["step"]
        size = f"{degrees(step):.2g}°" if own["unit"] == "rad" else f"{1e3 * step:.2g} mm"
        each.append(f"joint '{name}' {size}" if own["joint"] else f"{name} {step:.2g} {own['unit']}")
    return listed(each, "columns")


def stuck_values(channels: Mapping[str, float], in_fitted: Sequence[str]) -> str:
    """Channels with the values at which they are stuck."""
    each = (f"{name} ({value:g}{' in what is fitted' * (name in in_fitted)})" for name, value in channels.items())
    return listed(each, "channels")


def what_was_unchecked(check: str, reason: str, channels: Sequence[str] = (), error: str = "") -> str:
    """Check that could not be made, and why."""
    checks = {"weight": "The weight", "contact": "A contact left out", "torques": "Joint torques"}
    reasons = {
        "no gravity": "the model has no gravity",
        "no force": "no force is measured",
        "not measured": f"it shows in {listed(channels, 'channels')} of the sensor, not measured here",
        "not fitted": f"it shows in {listed(channels, 'channels')}, not fitted here",
        "error": error,
    }
    return f"{checks[check]} could not be checked: {reasons[reason]}"


def beside_model(mass: float, model: float, **_: Any) -> str:
    """Mass beside the model's."""
    if mass < 0:
        return f"negative where the model has {model:.3g} kg"
    more = mass / model - 1
    return f"{percent(abs(more), 1)} {'more' if more > 0 else 'less'} than the model's"


def offsets_in_words(offsets: Mapping[str, Sequence[Any]], shares: Mapping[str, float] | None = None) -> str:
    """Offsets with their deviations and units, and shares in brackets if there are any."""
    each = (
        f"{channel} {value:.3g} ± {std:.2g} {unit}{f' ({percent(shares[channel])})' if shares else ''}"
        for channel, (value, std, unit) in offsets.items()
    )
    return listed(each, "channels")


def moves(moved: Sequence[Mapping[str, Any]]) -> str:
    """Sentence on the parameters that physical bodies move."""
    shifts = {f"{x['name']}{' of ' * bool(x['body'])}{x['body'] or ''}": x["z"] for x in moved}
    each = bracketed(shifts, "parameters", "+.1f")
    return f"In standard deviations, the updated model moves {each}." if moved else "It moves none of them."


def masses_in_words(masses: Mapping[str, Mapping[str, float | None]], **_: Any) -> str:
    """Masses with their limits beside the model's."""
    each = []
    for body, own in masses.items():
        lower, upper = own["lower"], own["upper"]
        limits = f"less than {upper:.3g}; " if upper else ""
        if lower:
            limits = f"{lower:.3g} to {upper:.3g}; " if upper else f"more than {lower:.3g}; "
        each.append(f"{body} {own['mass']:.3g} kg ({limits}model: {own['model']:.3g} kg)")
    return listed(each, "bodies")


def limits_in_units(at_most: Mapping[str, float], units: Mapping[str, str]) -> str:
    """Drives at their bounds with their upper limits."""
    return listed((f"{name} (at most {most:.2g} {units[name]})" for name, most in at_most.items()), "drives")


def inertias(joints: Mapping[str, Mapping[str, Any]]) -> str:
    """Shares of inertia in torques, with those of weight in brackets."""
    shares = (
        f"{joint} {percent(x['inertia'], 1)} ± {percent(x['inertia_std'], 1)} ({percent(x['weight'])})"
        for joint, x in joints.items()
    )
    return listed(shares, "joints")


def beyond_robots(mass: float, robot: float | None) -> str:
    """Mass of an unlikely payload beside that of the robot."""
    return f"{mass / robot:.2g} times all bodies of the model" if robot else "more than the strongest robots carry"


_FUNCTIONS: tuple[Callable[..., Any], ...] = (
    *(worse_pairs, advice, lead, ending, distances, above_fast_noise, in_each_log, causes_in_words),
    *(lateness, delay_stated, turned, steps_in_words, stuck_values, what_was_unchecked),
    *(beside_model, offsets_in_words, moves, masses_in_words, limits_in_units, inertias, beyond_robots),
)
WORDS: Mapping[str, Callable[..., Any]] = {
    **{each.__name__: each for each in _FUNCTIONS},
    "best_logs": lambda best, **_: listed((f"log {log}" for log in best), "logs"),
    "shares_of_samples": lambda shares: listed(
        (f"{joint} ({percent(share)} of the samples)" for joint, share in shares.items()), "joints"
    ),
    "millimetres": lambda position, **_: 1e3 * position,
    "turn": lambda orientation, **_: degrees(orientation),
    "far_above": lambda times, **_: times > FAR_ABOVE,
    "less": lambda ratio, **_: 1 - ratio,
    "ends": lambda limits, unit, **_: " and ".join(f"{value:.4g} {unit}" for value in limits),
    "weigh_or_turn": lambda mass, **_: "check the signs of all channels" if mass < 0 else "weigh the mechanism",
    "with_joints": lambda joints: listed((f"{body} (joint {joint})" for body, joint in joints.items()), "bodies"),
    "reasons": lambda fixed_by, **_: (
        " and ".join(fixed_by) or "the stated one alone: masses, friction and rotors are as uncertain as that"
    ),
    "largest_in_percent": lambda largest, **_: 100 * largest,
    "shares_in_percent": lambda shares, **_: listed(
        (f"{joint} {percent(share)}" for joint, share in shares.items()), "joints"
    ),
    "thousandth": lambda mass, **_: mass / 1e3,
}
"""Functions of a finding's values by their names in templates."""
