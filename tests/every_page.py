"""A page of each command that writes one, from minimal runs, for the tests of all pages."""

import driven_arm
import numpy as np
import pytest
import wrist
from marked import labels_of, marked_person, trc, trial
from pages import PENDULUM, identified, options
from persons import briefly
from registered import TEXT, files_of, recorded
from registered import written as entry_file
from stand_ins import Here, leave_undrawn, use_truth

import scenes
from experiments.data import paper
from experiments.document.writer import PAGE
from experiments.runs import workers
from experiments.studies import person_on_plates as persons_study
from experiments.studies.validation.files import read_entry
from multicontact.__main__ import COMMANDS as MODULES
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.simulation.simulate import simulate

PNG = ["--formats", "png"]
SHORT = ["--samples", "150"]


def _run(folder, name, *arguments):
    """Exit code of a command that writes into `out`."""
    return MODULES[name].main([*map(str, arguments), "--out", str(folder / "out"), *PNG])


def _identify(folder):
    identified(folder)
    return 0


def _compare(folder):
    with pytest.MonkeyPatch.context() as patched:
        leave_undrawn(patched)
        for seed, name in enumerate("ab"):
            assert MODULES["identify"].main(options(folder, "--name", name, seed=seed)) == 0
    return _run(folder, "compare", folder / "a", folder / "b")


def _payload(folder):
    (folder / "arm.xml").write_text(wrist.model(), encoding="utf-8")
    wrist.log(seconds=4.0).save(folder / "arm.npz")
    given = [folder / "arm.xml", folder / "arm.npz", "--body", "tool", "--sensor", "wrist", "--name", "out"]
    return MODULES["payload"].main([*map(str, given), "--out", str(folder)])


def _stream(folder):
    simulate(scenes.load("double_pendulum"), DOUBLE_PENDULUM, samples=200).save(folder / "log.npz")
    given = [PENDULUM, folder / "log.npz", "--base", "base", "--cutoff", "8", "--name", "out", "--out", folder]
    return MODULES["stream"].main([*map(str, given), *PNG])


def _angles(folder):
    spec = marked_person()
    model = spec.compile()
    (folder / "person.xml").write_text(spec.to_xml())
    time, _, x = trial(model, 40)
    x += 0.002 * np.random.default_rng(0).normal(size=x.shape)
    (folder / "walk.trc").write_text(trc(time, labels_of(model), x))
    return _run(folder, "angles", folder / "person.xml", folder / "walk.trc", "--scale")


def _validate(folder):
    recorded(folder / "arm")
    text = TEXT.format(files=files_of(folder / "arm"), more="")
    entry = read_entry(entry_file(folder, text))
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("experiments.studies.validation.files.registry", lambda: {"arm": entry})
        return _run(folder, "validate", "--data", folder, "--workers", "1")


def _batch(folder):
    (folder / "arm.xml").write_text(driven_arm.text(), encoding="utf-8")
    logs = [folder / f"run{seed}.csv" for seed in range(2)]
    for seed, log in enumerate(logs):
        driven_arm.log(4.0, 50.0, seed=seed).save(log)
    return _run(folder, "batch", folder / "arm.xml", *logs, "--estimator", "weighted", "--cutoff", "8")


def _paper(folder):
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(paper, "SAMPLES", 200)
        return _run(folder, "paper")


COMMANDS = {
    "identify": _identify,
    "compare": _compare,
    "payload": _payload,
    "stream": _stream,
    "angles": _angles,
    "human": lambda folder: _run(folder, "human", "--workers", "1"),
    "validate": _validate,
    "sweep": lambda folder: _run(folder, "sweep", "multicontact", "--over", "samples", "100", "150"),
    "batch": _batch,
    "mechanism": lambda folder: _run(folder, "mechanism"),
    "excite": lambda folder: _run(folder, "excite", "double_pendulum", "--starts", "1", "--iterations", "3"),
    "misaligned": lambda folder: _run(folder, "misaligned", *SHORT, "--trials", "2", "--redraw", "sensors"),
    "multicontact": lambda folder: _run(folder, "multicontact", *SHORT),
    "study": lambda folder: _run(folder, "study", "several_contacts", *SHORT),
    "paper": _paper,
}
"""Functions that write a command's page into `out` in a folder, by names of `multicontact.__main__`; 0 on success."""

PLACES = {"paper": "index.html", "sweep": f"multicontact/samples/{PAGE}"}


def written(name, folder):
    """Writes the page of a command, with the truth as the studies' trajectory estimates, and returns its file."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(workers, "Processes", Here)
        patched.setattr(persons_study, "study", lambda *_, **__: briefly())
        use_truth(patched)
        assert COMMANDS[name](folder) == 0
    return folder / "out" / PLACES.get(name, PAGE)
