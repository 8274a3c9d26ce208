"""Other software on the same logs: what it gets, that its parameters are read as meant, and what is said without it."""

import numpy as np
import pytest

from experiments.studies.validation import peers
from ident.identification import identify
from ident.model.regressor import joint_torque_regressor
from ident.recordings.recording import Recording
from sim.models.model_mechanism import mechanism

LINK = """<link name="{name}"><inertial><origin xyz="0.02 0 -0.2"/><mass value="{mass}"/>
<inertia ixx="0.02" iyy="0.02" izz="0.005" ixy="0" ixz="0.001" iyz="0"/></inertial>
<visual><geometry><mesh filename="nowhere.stl"/></geometry></visual></link>"""
JOINT = """<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="0 0 {z}"/><axis xyz="0 1 0"/></joint>"""
URDF = "\n".join(
    [
        '<?xml version="1.0"?><robot name="two"><link name="world"/>',
        LINK.format(name="upper", mass=2.0),
        LINK.format(name="lower", mass=1.0),
        JOINT.format(name="shoulder", parent="world", child="upper", z=0),
        JOINT.format(name="elbow", parent="upper", child="lower", z=-0.4),
        "</robot>",
    ]
)
COULOMB, VISCOUS = (0.3, 0.2), (0.1, 0.05)


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    """Path of the model, and the estimate from its exact torques with a little noise."""
    path = tmp_path_factory.mktemp("arm") / "two.urdf"
    path.write_text(URDF, encoding="utf-8")
    with pytest.warns(Warning, match="nowhere"):
        two = mechanism(path)
    rng, time = np.random.default_rng(0), np.arange(0, 12, 0.01)
    phase, rates = rng.uniform(0, 6, (4, 2)), np.array([1.1, 2.3, 3.1, 4.7])[:, None]
    q, dq, ddq = (
        sum(0.35 * w**k * np.sin(w * time[:, None] + p + k * np.pi / 2) for w, p in zip(rates, phase, strict=True))
        for k in range(3)
    )
    links = joint_torque_regressor(two.tree, q, dq, ddq, gravity=two.gravity) @ two.known
    torque = links + np.sign(dq) * COULOMB + dq * VISCOUS
    noisy = {
        "position": q + 1e-5 * rng.standard_normal(q.shape),
        "torque": torque + 0.01 * rng.standard_normal(q.shape),
    }
    columns = {f"{joint}_{kind}": x[:, k] for kind, x in noisy.items() for k, joint in enumerate(two.joints)}
    return path, identify(two, Recording(time, columns))


@pytest.mark.slow
def test_plain_least_squares_are_compared_and_what_is_missing_names_the_extra(arm, monkeypatch):
    def missing(name):
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)

    monkeypatch.setattr(peers, "import_module", missing)
    path, estimate = arm
    answers = peers.compared(path, estimate, [])
    assert list(answers) == ["plain least squares", "FIGAROH", "mujoco.sysid"]
    plain = answers["plain least squares"]
    assert max(plain["ratios"]) < 0.2 and len(plain["ratios"]) == 2 and plain["seconds"] > 0
    for name in ("FIGAROH", "mujoco.sysid"):
        assert "which the extra 'peers' brings: pip install" in answers[name]
    assert list(peers.compared(path.with_suffix(".xml"), estimate, [])) == ["plain least squares"]


@pytest.mark.extras
@pytest.mark.parametrize(("name", "package"), [("FIGAROH", "figaroh"), ("mujoco.sysid", "absl")])
def test_other_software_s_parameters_predict_an_arm_without_much_noise(arm, name, package, monkeypatch):
    pytest.importorskip(package, reason="it is in the extra 'peers'")
    monkeypatch.setattr(peers, "PEERS", {name: peers.PEERS[name]})
    path, estimate = arm
    answer = peers.compared(path, estimate, [])[name]
    assert max(answer["ratios"]) < 0.2
