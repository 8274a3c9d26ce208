"""Mistakes in calls of `multicontact` are one sentence: the argument, what it needs, and what it got."""

import subprocess
import sys

import driven_arm
import estimates
import numpy as np
import pytest

import multicontact as mc

ARM = driven_arm.mechanism()
PENDULUM = mc.mechanism(mc.scenes.load("double_pendulum"), base="base")
ESTIMATE = estimates.quick
A_MECHANISM = r'needs a Mechanism, such as mc\.mechanism\("arm\.xml"\); got'
A_PATH = "^path needs a path; got 3"


def fixed(fix):
    return mc.mechanism(mc.scenes.load("double_pendulum"), base="base", fix=fix)


@pytest.mark.parametrize(
    ("fix", "as_if"),
    [
        ({"joint2": -0.3}, {"joint2": [-0.3]}),
        ({"joint2": np.float32(0.5)}, {"joint2": [0.5]}),
        ("joint2", {"joint2": ()}),
        (["joint2"], {"joint2": ()}),
    ],
)
def test_a_joint_is_fixed_by_a_number_or_by_its_name_alone(fix, as_if):
    assert fixed(fix).tree == fixed(as_if).tree
    assert fixed(fix).tree.joints == ("joint1",)


class DataFrame:
    """An object that is no estimate."""


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: mc.identify("arm.xml", "run.csv"), f"^mechanism {A_MECHANISM} 'arm.xml'"),
        (lambda: mc.identify(ESTIMATE(), "run.csv"), f"^mechanism {A_MECHANISM} an object of type Estimate"),
        (
            lambda: mc.identify(ARM, ESTIMATE()),
            "^recording needs a Recording, .*, or a list; got an object of type Est",
        ),
        (
            lambda: mc.identify(ARM, "run.csv", columns=["a"]),
            "^columns needs the path of a TOML file, .*; got \\['a'\\]",
        ),
        (lambda: mc.read_log("run.csv", "arm.xml"), f"^mechanism {A_MECHANISM} 'arm.xml'"),
        (lambda: mc.find_base_parameters("arm.xml"), f"^source {A_MECHANISM} 'arm.xml'"),
        (lambda: mc.identify_payload("arm.xml", [], body="a", sensor="b"), f"^robot {A_MECHANISM} 'arm.xml'"),
        (
            lambda: mc.identify_payload(ARM, "a.csv", body="a", sensor="b"),
            "^recording\\[0\\] needs a Recording, .*; got 'a'",
        ),
        (
            lambda: mc.write_model("new.xml", PENDULUM, ESTIMATE()),
            "^phi needs .* estimate\\.consistent\\(\\); got an object of",
        ),
        (
            lambda: mc.write_model("new.xml", PENDULUM, None),
            "^The bodies base, .* need 30 finite parameters, got shape",
        ),
        (
            lambda: mc.write_model(ARM, "new.xml", None),
            "^path needs the path of a file to write; got an object of type Mec",
        ),
        (lambda: mc.write_model("new.xml", "arm.xml", None), f"^mechanism {A_MECHANISM} 'arm.xml'"),
        (lambda: mc.updated_spec("arm.xml", None), f"^mechanism {A_MECHANISM} 'arm.xml'"),
        (lambda: mc.mechanism(None), "^source needs the path of a model, an MjSpec or an MjModel; got None"),
        (lambda: mc.tree_from_model(3), "^source needs the path of a model, .*; got 3"),
        (lambda: mc.report(DataFrame(), "out"), "^estimate needs an Estimate, .*; got an object of type DataFrame"),
        (lambda: mc.report(ESTIMATE(), None), "^folder needs the path of a folder; got None"),
        (lambda: mc.Estimate.load(3), A_PATH),
        (lambda: ESTIMATE().save(3), A_PATH),
        (lambda: mc.Recording.load(3), A_PATH),
        (lambda: driven_arm.log(4.0, 50.0).save(3), A_PATH),
        (
            lambda: mc.simulate(mc.scenes.load("double_pendulum"), None),
            "^excitation needs a desired motion, .*; got None",
        ),
        (lambda: mc.simulate("arm.xml", None), "^spec needs an MjSpec, such as .*; got 'arm.xml'"),
        (lambda: ESTIMATE().predict(driven_arm.log(4.0, 50.0)), "^motion needs a Motion.*; got an object of type Rec"),
        (lambda: fixed({"joint1": "here"}), "^fix needs joints .*; 'joint1' is given 'here'"),
        (lambda: fixed({3: 0.1}), "^fix needs joints .*; got {3: 0.1}"),
    ],
)
def test_a_mistake_is_one_sentence(call, message):
    with pytest.raises(mc.InputError, match=message) as raised:
        call()
    assert "\n" not in str(raised.value) and len(str(raised.value)) < 250


@pytest.mark.parametrize("name", ["new.npz", "new.csv", "new.xml"])
def test_a_folder_that_is_missing_is_one_sentence(name, tmp_path):
    path, estimate = tmp_path / "nowhere" / name, ESTIMATE()
    calls = {
        "new.npz": [estimate.save, driven_arm.log(4.0, 50.0).save],
        "new.csv": [driven_arm.log(4.0, 50.0).save],
        "new.xml": [lambda path: mc.write_model(path, PENDULUM, PENDULUM.known)],
    }
    for call in calls[name]:
        with pytest.raises(mc.InputError, match=r"nowhere' does not exist; make it first\.$"):
            call(path)


def test_a_misspelt_command_names_those_that_are_near():
    run = subprocess.run([sys.executable, "-m", "multicontact", "idntify"], capture_output=True, text=True)
    assert run.returncode == 2 and "there is no command 'idntify'; near that are identify" in run.stderr
    run = subprocess.run([sys.executable, "-m", "multicontact", "xyzxyz"], capture_output=True, text=True)
    assert run.returncode == 2 and "near that are paper, mechanism" in run.stderr
