"""The table of findings: every sentence, with examples of its values."""

import ast
import json
import re
from dataclasses import replace
from pathlib import Path
from string import Formatter

import pytest

import ident
from ident.judgement.finding import FINDINGS, Finding, Place, title_of
from ident.judgement.wording import WORDS

LATE = {"of": "ground", "axis": None, "value": 0.02, "std": 0.001}
ABOUT_X = {"of": "ground", "axis": "x", "value": -0.03, "std": 0.002, "log": 2}
JOINT = {"of": "hip", "axis": None, "value": 0.05, "std": 0.01, "together": ["a turn of all joint axes about z"]}
OTHERS = [{"kind": "gain", "of": "Fz", "axis": None}, {"kind": "gravity", "of": "", "axis": "y"}]
MASSES = {
    "masses": {
        "link1": {"mass": 2.5, "lower": 2.3, "upper": 2.9, "model": 1.0},
        "link2": {"mass": 2.5, "lower": 2.3, "upper": None, "model": 1.0},
        "tool": {"mass": 1, "lower": None, "upper": None, "model": 0.3},
    }
}
MOVED = {"moved": [{"name": "m2rz2", "body": "link2", "z": 1.2}, {"name": "Fv(hip)", "body": None, "z": -0.4}]}
SPAN = {"start": 1.0, "end": 2.5, "carries": 0.3}
CLIPPED = {"channel": "Fz", "limits": (-500.0, 500.0), "unit": "N", "share": 0.1}
GRAVITY = {"rpy_deg": (180.0, 0.0, 0.0), "stated": 0.8, "misfit": 0.1, "moving": False, "joint": None}
TRACKED = {"name": "flange", "position": 1e-4, "orientation": 2e-4, "times": 1.1}
WORSE = {"Fy": (0.3, 0.2)}
DELAY = {"delay": 0.5, "std": 0.01, "stated": 0.8, "misfit": 0.1}
FRAME = {"wrench": "ground", "error": 1.4, "error_turned": 0.2, "axes": {"x": "-y", "y": "x", "z": "z"}}
STEPS = [
    {"name": "Fz", "joint": False, "step": 0.5, "unit": "N"},
    {"name": "hip", "joint": True, "step": 0.0015, "unit": "rad"},
    {"name": "rail", "joint": True, "step": 0.001, "unit": "m"},
]

EXAMPLES = {
    "worse_than_candidate": [
        {"worse": {"least squares": WORSE}, "take": "least squares", "cutoff_hz": 4.0},
        {"worse": {"least squares": WORSE}, "take": "least squares", "cutoff_hz": None},
        {"worse": {"model": WORSE | {"Mz": (0.5, 0.1)}}, "take": "model", "cutoff_hz": 4.0},
        {"worse": {"least squares": WORSE, "model": WORSE}, "take": None, "cutoff_hz": 4.0},
        {"worse": {"least squares": WORSE}, "take": "nothing", "cutoff_hz": 4.0},
    ],
    "candidate_better": [
        {"candidate": "least squares", "behind": 1.11, "ratios": {"hip": (0.3, 0.28), "knee": (0.4, 0.35)}},
        {"candidate": "model", "behind": 1.06, "ratios": {f"joint{k}": (0.3, 0.28) for k in range(9)}},
    ],
    "residual_above_signal": [{"ratios": {"Fx": 1.2}, "part": "held-out"}],
    "unexplained_channels": [{"ratios": {"Fx": 0.98}, "part": "fitted"}],
    "poor_prediction": [{"ratios": {"Fx": 0.6, "Fy": 0.7}, "part": "held-out"}],
    "residual_follows_motion": [{"channels": ("Fx", "Mz")}],
    "unmodelled": [
        {"causes": [{"kind": "force", "body": "link2"}, {"kind": "length", "body": "link2"}], "ratio": 0.62}
    ],
    "residual_above_fast_noise": [
        {"factors": {"Fx": 4.0, "Fy": 300.0}, "all_channels": False},
        {"factors": {"Fx": 4.0, "Fy": 300.0}, "all_channels": True},
        {"factors": {"Fx": 200.0, "Fy": 300.0}, "all_channels": True},
    ],
    "wrench_sign_or_axes": [
        FRAME | {"opposite": False, "frame": "transposed"},
        FRAME | {"opposite": True, "frame": "turned"},
        FRAME | {"opposite": True, "frame": "as stated"},
        FRAME | {"opposite": True, "frame": "as stated", "rpy_deg": [180.0, 0.0, 0.0]},
    ],
    "mirrored_components": [{"wrench": "ground", "components": parts} for parts in (("Fy",), ("Fy", "Mx"))],
    "other_base": [{"body": "foot", "error": 1.2, "error_there": 0.1}],
    "contact_left_out": [{"body": "hand", "point": [0.0, 0.1, 0.25], "explained": 0.8}],
    "unmeasured_contact": [SPAN | {"body": None, "log": None}, SPAN | {"body": "pelvis", "log": 2}],
    "weight_differs": [{"measured": 50.0, "model": 60.0}],
    "weight_drifts": [{"drift": -2.0}],
    "mass_by_setup": [{"mass": 21.0, "std": 0.1, "weighed": 23.0, "model": 20.9}],
    "mass_or_common_gain": [
        {"mass": mass, "std": 0.4, "model": model} for mass, model in ((22.0, 20.0), (18.0, 20.0), (-1.24, 1.2))
    ],
    "large_offsets": [
        {"offsets": {"Fx": (25.0, 0.1, "N"), "My": (3.0, 0.1, "N m")}, "shares": {"Fx": 0.12, "My": 0.2}}
    ],
    "offsets_taken_out": [{"offsets": {"Fx": (25.0, 0.1, "N"), "hip": (3.0, 0.1, "N m")}}],
    "offsets_not_fitted": [{"offsets": {"Mz": (2.0, 0.1, "N m")}}],
    "inseparable_offsets": [{"channels": ("Fz",)}],
    "out_of_plane": [{"normal": "z", "channels": ("Fz", "Mx", "My")}],
    "clipped_channel": [CLIPPED | {"kept": True, "log": None}, CLIPPED | {"kept": False, "log": 2}],
    "coarse_steps": [{"steps": STEPS}],
    "tracked_poses": [TRACKED, TRACKED | {"position": 5e-3, "times": 40.0}],
    "stuck_channels": [{"channels": {"Fx": 0.0, "My": 1.5}, "in_fitted": ("My",)}],
    "unchecked": [
        *({"check": "weight", "reason": reason} for reason in ("no gravity", "no force")),
        {"check": "weight", "reason": "not measured", "channels": ("Fz",)},
        {"check": "contact", "reason": "not fitted", "channels": ("Fz", "Mx")},
        {"check": "torques", "reason": "error", "error": "Singular matrix"},
    ],
    "torque_sign": [{"joints": ("hip", "knee")}],
    "torque_scale": [{"gains": {"hip": 0.01}, "load": None}, {"gains": {"hip": 9.0}, "load": "hand"}],
    "torque_scale_estimated": [
        {"joints": ("hip", "knee"), "fixed_by": fixed} for fixed in ((), ("the wrench", "bodies"))
    ],
    "motion_not_by_torques": [
        {"joints": {"hip": {"weight": 1.02, "weight_std": 0.01, "inertia": 0.004, "inertia_std": 0.012}}}
    ],
    "loop_left_out": [{"loop": "close", "joints": ("knee", "ankle")}],
    "computed_torques": [{"joints": ("hip", "knee"), "largest": 0.0132}],
    "body_not_carried": [{"body": "tool", "explained": 0.9}],
    "friction_not_fitted": [{"shares": {"hip": 0.4}, "drives": ("viscous", "coulomb")}],
    "drive_at_bound": [
        {"at_most": at_most, "units": {"Fc(hip)": "N m", "Ia(rail)": "kg"}}
        for at_most in ({"Fc(hip)": 0.13}, {"Fc(hip)": 0.13, "Ia(rail)": 2.0})
    ],
    "breakaway_friction": [
        {"velocities": {"hip": 0.05}, "at_rest": at_rest} for at_rest in ({"hip": 0.1}, {"hip": float("nan")}, {})
    ],
    "low_velocity_friction": [{"values": {"hip": 0.3}}],
    "smooth_coulomb_friction": [{"velocities": {"hip": 0.05}}],
    "setup_delay": [LATE, LATE | {"value": -0.02, "alternatives": OTHERS}],
    "setup_lag": [LATE | {"of": ""}, LATE | {"of": "", "value": -0.02}],
    "setup_clock": [LATE | {"value": 0.005, "of": "plate + rail"}],
    "setup_origin": [ABOUT_X],
    "setup_rotation": [ABOUT_X],
    "setup_gain": [LATE | {"of": "plate Fx"}],
    "setup_torque_delay": [LATE | {"of": ""}],
    "setup_tracker_delay": [LATE | {"of": ""}],
    "setup_gravity": [ABOUT_X | {"of": ""}],
    "setup_scale": [JOINT | {"alternatives": ()}],
    "setup_zero": [JOINT | {"alternatives": OTHERS}],
    "setup_axis": [JOINT | {"axis": "y"}],
    "setup_centre": [JOINT | {"axis": "y"}, JOINT | {"axis": "z", "link": "-hip"}],
    "gravity_direction": [GRAVITY, GRAVITY | {"joint": "hip"}, GRAVITY | {"moving": True}],
    "channels_late": [DELAY | {"of": "wrench"}, DELAY | {"of": "torques", "delay": -0.4}],
    "setup_unexplained": [{"changed": True}, {"changed": False}],
    "not_converged": [{"status": status, "rounds": 2} for status in ("interrupted", "stuck", "stopped")]
    + [{"status": "interrupted", "rounds": 1}],
    "halves_disagree": [{"rms_z": 2.3}],
    "parameter_widened": [{"factors": {"m1ry1": 9.7}}],
    "logs_disagree": [{"logs": (1, 4), "rms_z": (2.5, 5.0), "best": best} for best in ((), (4,), (1, 4))],
    "own_in_logs": [{"values": {"Fc(hip)": (0.3, 0.45), "offset(hip)": (0.0, -0.12)}}],
    "motion_repeats": [{"periods": (6.48,)}, {"periods": (6.48, 5.0)}],
    "logs_repeat": [{"logs": (1, 2, 3)}],
    "prior_beside_data": [{}],
    "prior_needed": [{}],
    "beyond_joint_ranges": [{"shares": {"hip": 0.02}}],
    "unfiltered_wrenches": [{}],
    "joint_noise_not_included": [{}],
    "torque_scale_taken_as_exact": [{"joints": ("hip", "knee")}],
    "setup_taken_as_exact": [{"kinds": ("delay", "gain")}],
    "model_not_contradicted": [{}],
    "physical_within_region": [MOVED, {"moved": []}],
    "no_physical_bodies": [MOVED, {"moved": []}],
    "masses_shown": [MASSES | {"factor": 2.0}],
    "rotors_apart": [{"rotors": {"Ia(hip)": 0.02}}],
    "masses_limited": [MASSES | {"factor": 2.0}],
    "masses_hardly_shown": [MASSES | {"factor": 2.0}],
    "rotor_not_fitted": [{"joints": {"link3": "joint3"}}],
    "rotor_inseparable": [{"joints": {"link1": "joint1", "link2": "joint2"}}],
    "heavier_last_link": [{"body": "hand", "mass": 0.81, "std": 0.07}],
    "payload_forces_unexplained": [{"ratios": {"Fx": 0.97, "Fz": 0.93}}],
    "payload_mass_unlikely": [
        {"mass": mass, "robot": robot} for mass, robot in ((799.6, 8.7), (12.4, 8.7), (210500.0, None))
    ],
    "load_not_shown": [{"mass": 0.02, "std": 0.03}],
    "load_weighs_another": [{"mass": 2.03, "std": 0.08, "weighed": 20.0}],
    "load_changes_friction": [{}],
    "load_recordings_differ": [{"rms_z": 1.7}],
    "payload_mass_unknown": [{"quantities": ["mass", "centre z"]}],
    "payload_axis_rough": [{"x": 0.02, "y": -1.0, "z": 0.05, "std": 0.32, "prior": 0.26}],
    "payload_inertia_unknown": [{"quantities": ["Ixx", "Ixy"]}],
}


@pytest.mark.parametrize("code", FINDINGS)
def test_every_sentence_is_rendered_and_the_same_from_a_file(code):
    for values in EXAMPLES[code]:
        finding = Finding(code, values, False)
        assert re.fullmatch(r"[A-Z].*\.", finding.text) and finding.text in finding.line
        assert not re.search(r"[{}]|  |None|\.\.", finding.text) and ("nan" in str(values)) == ("(nan)" in finding.text)
        # Lists of names and numbers may be longer.
        sentences = [each.split(": ")[0] for each in re.split(r"(?<=\.) (?=[A-Z])", finding.text)]
        assert max(len(each.split()) for each in sentences) <= 25
        assert not re.search(r"\d%", finding.text)
        read = json.loads(json.dumps(finding.to_dict(), allow_nan=False))
        for number in range(6):
            placed = replace(finding, place=Place(channels=tuple(f"left leg_{k}" for k in range(number))))
            assert len(placed.title.split()) <= 7
        assert read["code"] == code and read["text"] == finding.text == FINDINGS[code].rendered(read["values"])


def test_titles_of_friction_are_those_of_their_sentences():
    assert title_of("breakaway_friction") == "Breakaway friction"
    assert title_of("low_velocity_friction") == "Stribeck friction"


def names(template):
    for _, name, spec, _ in Formatter().parse(template):
        if name:
            yield from (name, *names(spec))


def test_templates_name_values_and_words_alone_and_every_word_is_named():
    assert EXAMPLES.keys() == FINDINGS.keys()
    named = {code: {*names(row.text)} for code, row in FINDINGS.items() if isinstance(row.text, str)}
    for code, own in named.items():
        assert own <= {key for values in EXAMPLES[code] for key in values} | WORDS.keys(), code
    assert WORDS.keys() <= set().union(*named.values())


def nine(value):
    """Nine entries with names of their own, where there are some; but not of candidates or axes."""
    names = [f"part{k}" for k in range(9)]
    if isinstance(value, dict) and value and not value.keys() & {"least squares", "model", "x", "kind"}:
        return dict.fromkeys(names, next(iter(value.values())))
    if isinstance(value, tuple) and value and isinstance(value[0], str):
        return tuple(names)
    if isinstance(value, list) and value and isinstance(value[0], dict) and "name" in value[0]:
        return [{**value[0], "name": name} for name in names]
    return value


@pytest.mark.parametrize("code", FINDINGS)
def test_more_than_four_names_are_counted(code):
    """But for those of a command, which is to be copied, and those whose columns are to be mended."""
    most = 8 if code in ("torque_sign", "mirrored_components") else 4
    for values in EXAMPLES[code]:
        many = {key: nine(value) if key != "fixed_by" else value for key, value in values.items()}
        text = Finding(code, many, False).text
        names = set(re.findall(r"part\d", re.sub(r"--leave-out [^.;]*|--drive [^.;]*", "", text)))
        assert len(names) <= most and (most == 4 or "part7 and 1 other" in text), text
        assert "  " not in text, text


def test_every_code_is_the_finding_of_some_judge():
    """Codes are written out wherever they are used, but for those of the set-up's kinds."""
    room = Path(ident.__file__).parent / "judgement"
    trees = (ast.parse(path.read_text(encoding="utf-8")) for path in room.glob("*.py"))
    written = {node.value for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Constant)}
    assert {code for code in FINDINGS if code not in written and not code.startswith("setup_")} == set()


def test_a_doubt_is_of_the_row_or_of_the_judge_and_never_of_both():
    assert Finding.of("weight_drifts", drift=1.0).doubt
    finding = Finding.of("weight_differs", Place(channels=("Fz",)), doubt=False, measured=1.0, model=2.0)
    assert not finding.doubt and finding.title == "Weight differs: Fz"
    assert replace(finding, place=Place(channels=tuple("abcde"))).title == "Weight differs"
    for wrong in ({"code": "weight_differs"}, {"code": "weight_drifts", "doubt": True}):
        with pytest.raises(ValueError, match="either from its row or from its judge"):
            Finding.of(wrong.pop("code"), **wrong)


WORDED = [
    ("mass_or_common_gain", {"mass": -1.24, "std": 0.1, "model": 1.2}, "± 0.1 kg, is negative where the model has"),
    ("mass_or_common_gain", {"mass": 18.0, "std": 0.4, "model": 20.0}, "is 10.0 % less than the model's."),
    (
        "no_physical_bodies",
        {"moved": [{"name": k, "body": "", "z": k - 2.0} for k in range(6)]},
        "6 parameters (-2.0 to +3.0).",
    ),
    ("mirrored_components", {"wrench": "w", "components": ("Fx",)}, "Fx of the wrench 'w' looks mirrored"),
    ("mirrored_components", {"wrench": "w", "components": ("Fx", "Fy")}, "Fx, Fy of the wrench 'w' look mirrored"),
    ("unmeasured_contact", SPAN | {"body": "pelvis", "log": 2}, "Log 2: From 1.00 to 2.50 s"),
    ("unmeasured_contact", SPAN | {"body": None, "log": None}, "30 % of the weight. These"),
    ("breakaway_friction", {"velocities": {"hip": 0.05}, "at_rest": {}}, "there: there are no such samples."),
    ("masses_shown", MASSES | {"factor": 2.0}, "link2 2.5 kg (more than 2.3; model: 1 kg), tool 1 kg (model: 0.3"),
    ("computed_torques", {"joints": ("hip",), "largest": 0.0132}, "explained to 1.3 % without friction (hip)"),
    ("computed_torques", {"joints": ("hip",), "largest": 0.0996}, "explained to 10 % without friction (hip)"),
    ("clipped_channel", CLIPPED | {"kept": False, "log": 2}, "at -500 N and 500 N in log 2, in 10 %"),
    ("channels_late", DELAY | {"of": "torques", "delay": -0.4}, "torques look 400 ± 10 ms early before the joint"),
    ("tracked_poses", TRACKED, "0.1 mm and 0.011°."),
]


@pytest.mark.parametrize(("code", "values", "words"), WORDED)
def test_words_of_values(code, values, words):
    assert words in FINDINGS[code].rendered(values)
