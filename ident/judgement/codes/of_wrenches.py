"""Sentences on wrenches: frames, unmeasured contacts, weight and offsets."""

from collections.abc import Mapping, Sequence
from typing import Any

from ident.arguments import rpy_text
from ident.judgement.codes.row import Row, listed, percent


def _frame(
    wrench: str,
    opposite: bool,
    frame: str,
    axes: Mapping[str, str],
    error: float,
    error_turned: float,
    rpy_deg: Sequence[float] | None = None,
) -> str:
    turned = listed(f"{own} -> {other}" for own, other in axes.items())
    frames = {
        "as stated": "",
        "transposed": "a transposed frame (its rotation is that of the base in the sensor)",
        "turned": f"a turned frame (axes {turned})",
    }
    base = f" A base turned to rpy_deg = {rpy_text(rpy_deg)} would look alike." if rpy_deg else ""
    both = " and ".join(filter(None, ["the opposite sign" if opposite else "", frames[frame]]))
    return (
        f"The wrench '{wrench}' seems to have {both}. Its relative error against the model's prediction would fall "
        f"from {error:.2f} to {error_turned:.2f}. Mend its sign or frame in the columns file.{base}"
    )


def _mirrored(wrench: str, components: Sequence[str]) -> str:
    one = len(components) == 1
    return (
        f"{listed(components)} of the wrench '{wrench}' {'looks' if one else 'look'} mirrored: the opposite sign is "
        f"far nearer to the model's own prediction. Give {'its column' if one else 'their columns'} gain = -1 in the "
        "columns file."
    )


def _contact(body: str, point: Sequence[float], explained: float) -> str:
    at = listed(f"{x:.2f}" for x in point)
    return (
        f"A contact may be left out: forces through one point of '{body}' would explain {percent(explained)} of the "
        f"residual moment. In its frame the point is ({at}) m. Measure that contact, or avoid it."
    )


def _unmeasured(start: float, end: float, carries: float, body: str | None, log: int | None) -> str:
    on = f", as on '{body}'" if body else ""
    where = "" if log is None else f"Log {log}: "
    return (
        f"{where}From {start:.2f} to {end:.2f} s an unmeasured contact carries up to {percent(carries)} of the "
        f"weight{on}. These samples are left out."
    )


def _common_gain(mass: float, std: float, model: float) -> str:
    more = mass / model - 1
    return (
        f"The estimate's mass, {mass:.2f} ± {std:.2g} kg, is {percent(abs(more), 1)} {'more' if more > 0 else 'less'} "
        "than the model's. The recording cannot separate it from a gain that all channels share: weigh the mechanism."
    )


def _offset(channel: str, value: float, std: float, unit: str) -> str:
    return f"{channel} {value:.3g} ± {std:.2g} {unit}"


def _large(offsets: Mapping[str, Sequence[Any]], shares: Mapping[str, float]) -> str:
    each = listed(f"{_offset(channel, *offset)} ({percent(shares[channel])})" for channel, offset in offsets.items())
    return (
        "Constant offsets are large, in brackets relative to the model's weight, or to its moment at the mechanism's "
        f"reach: {each}. Tare the sensor, and check the model's mass and gravity, and unmeasured supports."
    )


def _taken_out(offsets: Mapping[str, Sequence[Any]]) -> str:
    return f"Constant offsets are taken out: {_all(offsets)}."


def _not_fitted(offsets: Mapping[str, Sequence[Any]]) -> str:
    return f"The measurements have constant offsets that were not fitted: {_all(offsets)}. Fit them with --offsets."


def _all(offsets: Mapping[str, Sequence[Any]]) -> str:
    return listed(_offset(channel, *offset) for channel, offset in offsets.items())


def _inseparable(channels: Sequence[str]) -> str:
    return (
        f"This motion does not separate constant offsets of {listed(channels)} from masses and first moments, which "
        "take them up. Tare these channels."
    )


def _out_of_plane(normal: str, channels: Sequence[str]) -> str:
    return (
        f"The model moves in the plane normal to {normal} alone, and cannot explain {listed(channels)}. Leave them "
        f"out: --leave-out {' '.join(channels)}."
    )


WRENCHES = {
    "wrench_sign_or_axes": Row(_frame, doubt=True),
    "mirrored_components": Row(_mirrored, doubt=True),
    "total_wrench_sign": Row(
        "The total wrench seems to have the opposite sign: its relative error against the model's prediction would "
        "fall from {error:.2f} to {error_turned:.2f}. Turn the sign of its columns.",
        doubt=True,
    ),
    "other_base": Row(
        "The wrench 'ground' seems to be measured in the frame of '{body}'. There its relative error against the "
        "model's prediction would fall from {error:.2f} to {error_there:.2f}. Try --base {body}.",
        doubt=True,
    ),
    "contact_left_out": Row(_contact, doubt=True),
    "unmeasured_contact": Row(_unmeasured, doubt=False),
    "weight_differs": Row(
        "The wrenches weigh {measured:.2f} kg, the model {model:.2f} kg. Check unmeasured contacts and supports, "
        "units, and whether the model is of this mechanism.",
        doubt=None,
    ),
    "weight_drifts": Row(
        "The weighed mass drifts by {drift:+.2f} kg over the recording. Look for an unmeasured contact or a drifting "
        "sensor.",
        doubt=True,
    ),
    "kilonewtons": Row(
        "The force is at most {largest:.3g} N, but the mechanism weighs {weight:.4g} N: its unit may be kN.",
        doubt=True,
    ),
    "mass_by_setup": Row(
        "By the estimated set-up the mechanism has {mass:.2f} ± {std:.2g} kg. The wrenches weigh {weighed:.2f} kg, the "
        "model {model:.2f} kg. Weigh it: if the wrenches are right, that set-up is not.",
        doubt=None,
    ),
    "mass_or_common_gain": Row(_common_gain, doubt=False),
    "large_offsets": Row(_large, doubt=True),
    "offsets_taken_out": Row(_taken_out, doubt=False),
    "offsets_not_fitted": Row(_not_fitted, doubt=True),
    "inseparable_offsets": Row(_inseparable, doubt=False),
    "out_of_plane": Row(_out_of_plane, doubt=False),
}
