"""Sentences on the fit: convergence, parts of the data that disagree, the prior, and assumptions."""

from collections.abc import Mapping, Sequence

from ident.judgement.codes.row import Row, listed, number_of, percent


def _not_converged(status: str, rounds: int) -> str:
    how = {"interrupted": "was interrupted", "stuck": "found no better step"}.get(status, "did not settle")
    return f"The trajectory estimate {how} after {number_of(rounds, 'round')}; its last iterate is given."


def _logs_disagree(logs: Sequence[int], rms_z: Sequence[float], best: Sequence[int] = ()) -> str:
    predicts = f"predicts log {listed(map(str, best))} best, about as well as others."
    still = f" Of all candidates, the estimate {predicts}" if best else ""
    each = listed(f"{log} ({z:.1f})" for log, z in zip(logs, rms_z, strict=True))
    return (
        f"Logs disagree: base parameters of a log differ from those of the others, in standard deviations from the "
        f"noise (root mean square) of log {each}. Something changed between them, as a load, a mounting or friction; "
        f"look at them one by one.{still}"
    )


def _own_in_logs(values: Mapping[str, Sequence[float]]) -> str:
    each = listed(f"{name} ({', '.join(f'{x:.2g}' for x in own)})" for name, own in values.items())
    return (
        f"Friction and offsets are not the same in all logs, so that each has its own: {each}. Another log is "
        "predicted with their means."
    )


def _beyond_ranges(shares: Mapping[str, float]) -> str:
    each = listed(f"{joint} ({percent(share)} of the samples)" for joint, share in shares.items())
    return f"Joints are recorded beyond the model's ranges: {each}; a zero, a sign or a unit may be wrong."


def _exact_torques(joints: Sequence[str]) -> str:
    return (
        f"The scale of the torques of {listed(joints)} is stated as uncertain (torque_std, kp_std), but least squares "
        "take it as exact. Its error is in the estimate and not in the standard deviations; --estimator trajectory "
        "estimates it."
    )


def _exact_setup(kinds: Sequence[str]) -> str:
    return (
        f"The set-up is stated as uncertain ({listed(kinds)}), but least squares take it as exact: the standard "
        "deviations are without it."
    )


FIT = {
    "not_converged": Row(_not_converged, doubt=True),
    "halves_disagree": Row(
        "Two halves of the data differ by {rms_z:.1f} of their standard deviations from the noise (root mean square). "
        "Model or set-up are not quite right, and those deviations are widened by as much.",
        doubt=False,
    ),
    "logs_disagree": Row(_logs_disagree, doubt=None),
    "own_in_logs": Row(_own_in_logs, doubt=False),
    "prior_beside_data": Row(
        "The model's bodies served as a prior, though the recordings determine all base parameters without it.",
        doubt=False,
    ),
    "prior_needed": Row(
        "The recordings alone do not determine all base parameters: the model's bodies served as a prior. Parameters "
        "that the data hardly determine stay near the model's; move further and faster to determine more.",
        doubt=False,
    ),
    "beyond_joint_ranges": Row(_beyond_ranges, doubt=True),
    "unfiltered_wrenches": Row(
        "Velocities and accelerations are the log's own and the wrenches are not filtered: if the log's were, --cutoff "
        "auto treats both alike.",
        doubt=False,
    ),
    "joint_noise_not_included": Row(
        "The standard deviations are those of noise on the wrenches; noise on the joint angles biases the estimate and "
        "is not in them.",
        doubt=False,
    ),
    "torque_scale_taken_as_exact": Row(_exact_torques, doubt=True),
    "setup_taken_as_exact": Row(_exact_setup, doubt=False),
}
