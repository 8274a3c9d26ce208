"""The table of all findings, by subject: code, sentence, and True for a doubt."""

from collections.abc import Mapping

from ident.judgement.codes.of_bodies import BODIES, PAYLOAD
from ident.judgement.codes.of_fit import FIT
from ident.judgement.codes.of_prediction import PREDICTION
from ident.judgement.codes.of_sensors import SENSORS, SETUP
from ident.judgement.codes.of_torques import TORQUES
from ident.judgement.codes.of_wrenches import WRENCHES
from ident.judgement.codes.row import Row

SUBJECTS = (PREDICTION, WRENCHES, SENSORS, TORQUES, SETUP, FIT, BODIES, PAYLOAD)

FINDINGS: Mapping[str, Row] = {code: row for rows in SUBJECTS for code, row in rows.items()}
"""Row of each code."""

TITLES = {
    "worse_than_candidate": "another candidate predicts clearly better",
    "candidate_better": "another candidate predicts somewhat better",
    "unexplained_channels": "this motion does not explain",
    "unmodelled": "the model lacks something",
    "wrench_sign_or_axes": "sign or axes of the wrench",
    "other_base": "wrench measured in another frame",
    "kilonewtons": "forces may be in kN",
    "mass_by_setup": "mass by set-up and mass weighed",
    "mass_or_common_gain": "another mass, or a common gain",
    "inseparable_offsets": "offsets inseparable from masses",
    "unchecked": "could not be checked",
    "friction_not_fitted": "friction is left out",
    "low_velocity_friction": "torques count less at low velocity",
    "body_not_carried": "a body that was not carried",
    "channels_late": "channels late against others",
    "own_in_logs": "friction or offsets differ between logs",
    "prior_beside_data": "the model's bodies were a prior, needlessly",
    "prior_needed": "the model's bodies served as a prior",
    "joint_noise_not_included": "noise of joints is not included",
    "model_not_contradicted": "the data do not contradict the model",
    "physical_within_region": "updated model within the 95 % region",
    "no_physical_bodies": "no physical bodies near the estimate",
    "masses_shown": "masses far from the model's",
    "masses_limited": "masses that no channel contains",
    "masses_hardly_shown": "masses that the data hardly show",
}
"""Short titles of findings whose codes are not words enough."""
