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
from experiments import (
    angles,
    batch,
    compare,
    excite,
    human,
    identify,
    mechanism,
    misaligned,
    multicontact,
    payload,
    stream,
    study,
    sweep,
    validate,
)
from experiments.__main__ import main as everything
from experiments.data import paper
from experiments.document.writer import PAGE
from experiments.runs import workers
from experiments.studies import person_on_plates as persons_study
from experiments.studies.validation.files import read_entry
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.simulation.simulate import simulate

PNG = ["--formats", "png"]
SHORT = ["--samples", "150", *PNG]
TRIALS = ["--trials", "2", "--redraw", "sensors"]


def _identify(folder):
    identified(folder)
    return 0


def _compare(folder):
    with pytest.MonkeyPatch.context() as patched:
        leave_undrawn(patched)
        for seed, name in enumerate("ab"):
            assert identify.main(options(folder, "--name", name, seed=seed)) == 0
    return compare.main([str(folder / "a"), str(folder / "b"), "--out", str(folder / "out")])


def _payload(folder):
    (folder / "arm.xml").write_text(wrist.model(), encoding="utf-8")
    wrist.log(seconds=4.0).save(folder / "arm.npz")
    files = [str(folder / "arm.xml"), str(folder / "arm.npz")]
    return payload.main([*files, "--body", "tool", "--sensor", "wrist", "--name", "out", "--out", str(folder)])


def _stream(folder):
    simulate(scenes.load("double_pendulum"), DOUBLE_PENDULUM, samples=200).save(folder / "log.npz")
    given = [str(PENDULUM), str(folder / "log.npz"), "--base", "base"]
    return stream.main([*given, "--cutoff", "8", "--name", "out", "--out", str(folder), *PNG])


def _angles(folder):
    spec = marked_person()
    model = spec.compile()
    (folder / "person.xml").write_text(spec.to_xml())
    time, _, x = trial(model, 40)
    x += 0.002 * np.random.default_rng(0).normal(size=x.shape)
    (folder / "walk.trc").write_text(trc(time, labels_of(model), x))
    return angles.main([*map(str, (folder / "person.xml", folder / "walk.trc")), "--scale", *_out(folder)])


def _validate(folder):
    recorded(folder / "arm")
    text = TEXT.format(files=files_of(folder / "arm"), more="")
    entry = read_entry(entry_file(folder, text))
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("experiments.studies.validation.files.registry", lambda: {"arm": entry})
        return validate.main(["--data", str(folder), "--workers", "1", *_out(folder)])


def _batch(folder):
    (folder / "arm.xml").write_text(driven_arm.text(), encoding="utf-8")
    logs = [folder / f"run{seed}.csv" for seed in range(2)]
    for seed, log in enumerate(logs):
        driven_arm.log(4.0, 50.0, seed=seed).save(log)
    files = map(str, (folder / "arm.xml", *logs))
    return batch.main([*files, "--estimator", "weighted", "--cutoff", "8", *_out(folder)])


def _sweep(folder):
    assert sweep.main(["multicontact", "--over", "samples", "100", "150", "--out", str(folder), *PNG]) == 0
    (folder / "multicontact" / "samples").rename(folder / "out")
    return 0


def _paper(folder):
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(paper, "SAMPLES", 200)
        return everything(_out(folder))


def _out(folder):
    return ["--out", str(folder / "out"), *PNG]


COMMANDS = {
    "identify": _identify,
    "compare": _compare,
    "payload": _payload,
    "stream": _stream,
    "angles": _angles,
    "human": lambda folder: human.main(["--workers", "1", *_out(folder)]),
    "validate": _validate,
    "sweep": _sweep,
    "batch": _batch,
    "mechanism": lambda folder: mechanism.main(_out(folder)),
    "excite": lambda folder: excite.main(["double_pendulum", "--starts", "1", "--iterations", "3", *_out(folder)]),
    "misaligned": lambda folder: misaligned.main(["--out", str(folder / "out"), *SHORT, *TRIALS]),
    "multicontact": lambda folder: multicontact.main(["--out", str(folder / "out"), *SHORT]),
    "study": lambda folder: study.main(["several_contacts", "--out", str(folder / "out"), *SHORT]),
    "paper": _paper,
}
"""Functions that write a command's page into `out` in a folder, by names of `experiments.cli.command`; 0 on success."""


def written(name, folder):
    """Writes the page of a command, with the truth as the studies' trajectory estimates, and returns its file."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(workers, "Processes", Here)
        patched.setattr(persons_study, "study", lambda *_, **__: briefly())
        use_truth(patched)
        assert COMMANDS[name](folder) == 0
    return folder / "out" / ("index.html" if name == "paper" else PAGE)
