"""Sentences on the fit: convergence, parts of the data that disagree, the prior, and assumptions."""

from collections.abc import Mapping, Sequence

from ident.judgement.codes.row import Row, listed, number_of, percent


def _not_converged(status: str, rounds: int) -> str:
    how = {"interrupted": "was interrupted", "stuck": "found no better step"}.get(status, "did not settle")
    after = number_of(rounds, "round")
    return f"The trajectory estimate {how} after {after}. Its last iterate is given; do not rely on it."


def _logs_disagree(logs: Sequence[int], rms_z: Sequence[float], best: Sequence[int] = ()) -> str:
    still = (
        f" It still predicts log {listed(map(str, best))} best, or about as well as other candidates." if best else ""
    )
    each = listed(f"{log} ({z:.1f})" for log, z in zip(logs, rms_z, strict=True))
    return (
        "Logs disagree on the base parameters, in root mean square standard deviations of the noise: "
        f"log {each}.{still} A load, a mounting or friction may have changed: identify the logs one by one."
    )


def _own_in_logs(values: Mapping[str, Sequence[float]]) -> str:
    each = listed(f"{name} ({', '.join(f'{x:.2g}' for x in own)})" for name, own in values.items())
    return (
        f"Friction and offsets differ between logs, so that each log has its own: {each}. Other logs are predicted "
        "with their means."
    )


def _beyond_ranges(shares: Mapping[str, float]) -> str:
    each = listed(f"{joint} ({percent(share)} of the samples)" for joint, share in shares.items())
    return f"Joints are recorded beyond the model's ranges: {each}. Check zero, sign and unit of their columns."


def _exact_torques(joints: Sequence[str]) -> str:
    return (
        f"Least squares take the scale of the torques of {listed(joints)} as exact, though it is stated as uncertain "
        "(torque_std, kp_std). The standard deviations are without its error; --estimator trajectory estimates it."
    )


def _exact_setup(kinds: Sequence[str]) -> str:
    return (
        f"Least squares take the set-up as exact, though it is stated as uncertain ({listed(kinds)}). The standard "
        "deviations are without its errors; --estimator trajectory estimates them."
    )


FIT = {
    "not_converged": Row(_not_converged, doubt=True),
    "halves_disagree": Row(
        "Two halves of the data differ by {rms_z:.1f} standard deviations of the noise (root mean square). Model or "
        "set-up are not quite right; all standard deviations are widened by as much.",
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
        "Velocities and accelerations are the log's own, and wrenches are not filtered. If the log's were filtered, "
        "--cutoff auto treats both alike.",
        doubt=False,
    ),
    "joint_noise_not_included": Row(
        "The standard deviations are those of noise on the wrenches. Noise on the joint angles biases the estimate, "
        "and is not in them; --estimator trajectory includes it.",
        doubt=False,
    ),
    "torque_scale_taken_as_exact": Row(_exact_torques, doubt=True),
    "setup_taken_as_exact": Row(_exact_setup, doubt=False),
}
