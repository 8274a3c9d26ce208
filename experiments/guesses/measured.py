"""Columns without names as the ground's wrench or as joint torques: those that the model's predictions explain."""

from collections.abc import Collection, Sequence

from scipy.optimize import linear_sum_assignment

from experiments.guesses.belief import LIKELY, Belief, Entry, Group, Quantity
from experiments.guesses.explained import Model, explained
from experiments.guesses.log_contents import LogContents
from experiments.guesses.orders import candidates, likeness
from ident.estimation.equations import COMPONENTS
from ident.mechanism.mechanism import Mechanism
from ident.recordings.wrench import GROUND

AGREES = 0.8
"""Share of a column's variance above which a prediction is accepted for it."""


def add_measured(belief: Belief, contents: LogContents, mechanism: Mechanism, held: bool) -> None:
    """Adds the ground's wrench, or else torques, if none is known: columns that the model's predictions explain."""
    positions = belief.of("position")
    moving = all(joint in positions and positions[joint].column in contents.columns for joint in mechanism.joints)
    known = belief.torques_undecided or belief.undecided or belief.groups or belief.of("torque")
    names = [name for name in candidates(belief, contents, 0)[1] if name not in belief.columns]
    if known or not moving or not names or not mechanism.joints or mechanism.prior is None:
        return
    model = Model.of(belief, contents, mechanism, [])
    like, channels = likeness(model, names, model.predicted(model.states_of({})))

    def matched(wanted: Collection[str]) -> dict[str, tuple[str, float]]:
        """Columns by channel, assigned by the largest sum of squared correlations, each with its own."""
        those = [k for k, channel in enumerate(channels) if channel in wanted]
        pairs = zip(*linear_sum_assignment(-like[:, those]), strict=True)
        found = {channels[those[k]]: (names[i], float(like[i, those[k]])) for i, k in pairs}
        return {channel: pair for channel, pair in found.items() if pair[1] > AGREES}

    wrench = matched(COMPONENTS) if held else {}
    if sum(component in COMPONENTS[:3] for component in wrench) > 1:
        columns = {component: column for component, (column, _) in wrench.items()}
        least = min(share for _, share in wrench.values())
        why = f"agrees with the model's prediction ({explained(1 - least)} of the variance or more)"
        for part in (COMPONENTS[:3], COMPONENTS[3:]):
            _fill(columns, part, contents.names, belief)
        parts = (("force", COMPONENTS[:3]), ("torque", COMPONENTS[3:]))
        entries = {key: Entry([columns.get(component, "") for component in part], why) for key, part in parts}
        belief.groups[GROUND] = Group(GROUND, entries)
        return
    torques = matched(mechanism.joints)
    for joint, (column, share) in torques.items() if 2 * len(torques) >= len(mechanism.joints) else ():
        why = f"agrees with the model's prediction ({explained(1 - share)} of the variance)"
        belief.add(Quantity(joint, "torque", column, LIKELY, [why]))


def _fill(columns: dict[str, str], part: Sequence[str], order: Sequence[str], belief: Belief) -> None:
    """Adds the third component if two are in order in the file."""
    places = {k: order.index(columns[c]) - k for k, c in enumerate(part) if c in columns}
    missing = [k for k in range(3) if k not in places]
    if len(missing) == 1 and len(set(places.values())) == 1:
        place = missing[0] + next(iter(places.values()))
        if 0 <= place < len(order) and order[place] not in (*columns.values(), *belief.columns):
            columns[part[missing[0]]] = order[place]
            belief.notes.append(
                f"Column '{order[place]}' is taken for {part[missing[0]]} by its place alone: the model predicts none."
            )
