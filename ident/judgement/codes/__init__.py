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
