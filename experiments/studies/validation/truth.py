"""Known parameters beside their estimates, in JSON types: weighed ones, and the true ones of simulations."""

import json
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.data.validation import Entry
from experiments.studies.user_files import read_mechanism
from experiments.studies.validation.files import columns_file, convert
from ident.errors import InputError
from ident.estimate import Estimate
from ident.geometry.inertia import parameters_from_com
from ident.mechanism.mechanism import Mechanism
from ident.payload.beyond_sensor import identify_payload
from ident.payload.identified_payload import QUANTITIES, UNITS, described
from ident.recordings.log import read_log

BODY = "tool"
"""Name of a body alone in the columns files."""


def of_estimate(entry: Entry, folder: Path, estimate: Estimate, results: Mapping[str, Any]) -> dict[str, Any]:
    """Known base parameters and drives of an entry, empty without any.

    Args:
        entry: The recording.
        folder: Folder of its files.
        estimate: Its estimate.
        results: Results of that in JSON types.
    """
    own, known = results["values"], dict[str, tuple[float, float]]()
    if entry.true_files:
        model = read_mechanism(folder / entry.true_files[0], base=entry.options.get("base"))
        true = replace(estimate.fit.equations, mechanism=model).from_model
        known |= {name: (float(x), 0.0) for name, x in zip(own["names"], true, strict=False)}
    known |= {each.name: (each.value, each.tolerance) for each in entry.truth}
    if not known:
        return {}
    at = [own["names"].index(name) for name in known]
    columns = {"names": "names", "units": "units", "values": "values", "std": "std_setup"}
    return {
        **{name: [own[key][k] for k in at] for name, key in columns.items()},
        "true": [value for value, _ in known.values()],
        "tolerance": [tolerance for _, tolerance in known.values()],
        "rivals": {name: [x[k] for k in at] for name, x in results["rivals"].items()},
    }


def of_bodies(entry: Entry, folder: Path, scratch: Path) -> dict[str, Any]:
    """Known mass, centre and inertia of bodies, each alone on a wrench sensor in a log, by level of added noise.

    Args:
        entry: The recording.
        folder: Folder of its files.
        scratch: Folder for files with noise.
    """
    return {level: _at_level(entry, folder, scratch, name) for level, name in entry.options["noise"].items()}


def _at_level(entry: Entry, folder: Path, scratch: Path, converter: str) -> dict[str, Any]:
    """Known parameters of bodies, with the noise of a converter."""
    start, out = time.process_time(), dict[str, list[Any]]()
    for (log,), file in zip(entry.fitted, entry.true_files, strict=True):
        alone = Mechanism.lone_body(BODY)
        convert(converter, folder / log, scratch / log)
        recording = read_log(scratch / log, alone, columns_file(entry.options["columns"]))
        offsets = entry.options.get("offsets", True)
        body = identify_payload(
            alone, recording, body=BODY, sensor=entry.sensor, offsets=offsets, holdout=0.0
        ).in_frame()
        true = _body(folder / file)
        rows = {"values": body.values, "std": body.std_setup, "true": true, "tolerance": np.zeros(len(true))}
        names = [f"{Path(log).stem} {name}" for name in QUANTITIES]
        for key, x in ({name: x.tolist() for name, x in rows.items()} | {"names": names, "units": UNITS}).items():
            out.setdefault(key, []).extend(x)
    return {**out, "rivals": {}, "seconds": time.process_time() - start}


def _body(path: Path) -> np.ndarray:
    """Quantities of a body (10,) in a JSON file, with `mass`, `centre` and `inertia_about_centre`."""
    try:
        known = json.loads(path.read_text(encoding="utf-8"))
        inertia = np.array(known["inertia_about_centre"], float)
        return described(parameters_from_com(known["mass"], np.array(known["centre"], float), inertia))
    except (ValueError, LookupError, TypeError) as error:
        raise InputError(f"'{path}' needs mass, centre and inertia_about_centre of a body ({error}).") from None
