# # A person on force plates
#
# This tutorial goes from markers on the skin and the wrenches of two force plates to a person's inertial parameters.
# Gait laboratories record such data, and public collections such as HuMoD contain them. Joint angles, accelerations
# and the masses of segments are not measured. The person is simulated, so that the true values are known; she does
# squats, then swings her arms. The page runs as it stands, in some seconds.

import contextlib
import io
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import multicontact as mc
from experiments import angles
from sim.motion import person

# ## A model with markers
#
# The scene's humanoid has a freely moving pelvis and human joints; wrists, toes and other small joints are stiff
# here. Three markers on each body are sites of the model; an OpenSim file already contains markers.

STIFF = ("neck", "pronation", "wrist", "toes", "subtalar", "thoracic_flexion", "bending", "rotation", "abduction")
rng = np.random.default_rng(3)
spec = mc.scenes.load("humanoid")
for joint in [joint for joint in spec.joints if any(word in joint.name for word in STIFF)]:
    spec.delete(joint)
for body in spec.bodies[1:]:
    for k in range(3):
        body.add_site(name=f"{body.name}_{k}", pos=rng.normal(scale=0.06, size=3))
Path("person.xml").write_text(spec.to_xml())
model = mc.mechanism("person.xml", base="pelvis")
base = mc.find_base_parameters(model, sensors=mc.Sensors(moving_base=True))
print(f"{len(model.bodies)} bodies, {model.mass:.1f} kg; joints: {', '.join(model.tree.joints)}")
print(f"{base.rank} base parameters of {len(model.known)}")

# ## What the laboratory measured
#
# This section simulates the measurement. The true person has a trunk that is 15 % heavier and legs that are 8 % lighter
# than the model's. Markers have noise of a millimetre; the plates have noise of 1 N and 0.3 N m.

heavier = {"abdomen": 1.15, "thorax": 1.15} | {f"{s}_{b}": 0.92 for s in ("left", "right") for b in ("thigh", "shank")}
truth = model.known.reshape(-1, 10) * np.array([[heavier.get(name, 1.0)] for name in model.bodies])


def recorded(activity, seconds=4.0, rate=50.0):
    """Times, markers by label, and wrenches of both plates: force, centre of pressure and free moment in the world."""
    time = np.arange(0, seconds, 1 / rate)
    motion = person.motion(model.tree, activity, time, person.Style(rail=False, seed=len(activity)))
    Y = mc.base_wrench_regressor(model.tree, *motion.states, gravity=model.gravity, base=motion.base)
    needed = mc.Wrench(Y @ truth.ravel(), "pelvis").values
    pelvis = motion.base.T
    force = (pelvis[:, :3, :3] @ needed[:, :3, None])[..., 0]
    moment = (pelvis[:, :3, :3] @ needed[:, 3:, None])[..., 0] + np.cross(pelvis[:, :3, 3], force)
    poses = pelvis[:, None] @ model.tree.poses(motion.q)
    markers = {}
    for name in model.bodies:
        for k in range(3):
            site = (poses[:, model.tree.names.index(name)] @ np.append(spec.site(f"{name}_{k}").pos, 1))[:, :3]
            markers[f"{name}_{k}"] = site + 1e-3 * rng.normal(size=site.shape)
    # The centre of pressure of both plates together tells how the feet share the load.
    x, y = -moment[:, 1] / force[:, 2], moment[:, 0] / force[:, 2]
    free = moment[:, 2] - x * force[:, 1] + y * force[:, 0]
    feet = {side: poses[0, model.tree.names.index(f"{side}_foot"), 1, 3] for side in ("left", "right")}
    right = (y - feet["left"]) / (feet["right"] - feet["left"])
    plates = {}
    for side, share in {"left": 1 - right, "right": right}.items():
        pushed = share[:, None] * force
        twisted = np.cross(np.column_stack([x, np.full_like(x, feet[side]), 0 * x]), pushed)
        twisted[:, 2] += share * free
        for part, values, noise in (("force", pushed, 1.0), ("torque", twisted, 0.3)):
            plates[f"{side}_{part}"] = values + noise * rng.normal(size=values.shape)
    return time, markers, plates


def write(name, time, vectors):
    """A CSV file of times and vectors (N, 3) by name."""
    header = ",".join(["time", *(f"{vector}.{axis}" for vector in vectors for axis in "xyz")])
    np.savetxt(name, np.column_stack([time, *vectors.values()]), delimiter=",", header=header, comments="", fmt="%.6f")


TRIALS = {"squats": "squats", "swings": "arm swings"}
for trial, activity in TRIALS.items():
    time, markers, plates = recorded(activity)
    write(f"{trial}_markers.csv", time, markers)
    write(f"{trial}_plates.csv", time, plates)
print(*sorted(path.name for path in Path().glob("*.csv")))

# ## Angles from markers
#
# `experiments.angles` fits the model to the markers, frame by frame, and writes the plates' wrenches into the same
# file. On the command line:
#
# ```sh
# multicontact angles person.xml squats_markers.csv --base pelvis --wrenches squats_plates.csv --out squats
# ```


def last_lines(command, arguments, count):
    """Runs a command and prints the end of what it says."""
    with contextlib.redirect_stdout(io.StringIO()) as output:
        command.main(arguments)
    print(*output.getvalue().splitlines()[-count:], sep="\n")


for trial in TRIALS:
    files = ["person.xml", f"{trial}_markers.csv", "--wrenches", f"{trial}_plates.csv"]
    last_lines(angles, [*files, "--base", "pelvis", "--out", trial, "--formats", "png"], 3)

# ## The plates
#
# They rest in the world, and their moments are about its origin. Each foot stays on its plate here; `on = "auto"` would
# detect which foot is on which plate. Nothing else holds the person: there is no ground wrench at the pelvis.

PLATE = """
[wrenches.{side}]
frame = "world"
on = "{side}_foot"
force = ["{side}_force.x", "{side}_force.y", "{side}_force.z"]
torque = ["{side}_torque.x", "{side}_torque.y", "{side}_torque.z"]
"""
Path("plates.toml").write_text("".join(PLATE.format(side=side) for side in ("left", "right")))

# ## The person
#
# Two trials share their parameters. A motion of some seconds cannot separate so many base parameters, so a prior
# of the person's segments is used: here the model's, with 20 % for each mass; `--prior winter`,
# `deleva` and `dumas` use published tables instead.
#
# ```sh
# multicontact identify person.xml squats/angles.csv swings/angles.csv \
#     --base pelvis --columns plates.toml --prior on
# ```

logs = [mc.read_log(f"{trial}/angles.csv", model, "plates.toml") for trial in TRIALS]
estimate = mc.identify(model, logs, known=True)
print(estimate.verdict())
print(*(f"- {finding.text}" for finding in estimate.findings), sep="\n")

# The estimate is a compromise between the prior and the plates. Compared with the true values (intervals include the
# prior, which here is more accurate than its standard deviations state):

true, was = (estimate.base.regroup(phi) for phi in (truth.ravel(), model.known))
inside = np.mean(np.abs(estimate.psi - true) < 1.96 * estimate.std_setup)
bodies = estimate.consistent().phi.reshape(-1, 10)
print(f"{100 * inside:.0f} % of the 95 % intervals contain the true value")
totals = [x.reshape(-1, 10)[:, 0].sum() for x in (model.known, bodies, truth)]
print("person: {:.1f} kg in the model, {:.1f} kg identified, {:.1f} kg true".format(*totals))
groups = {
    "trunk": ("abdomen", "thorax"),
    "thighs": ("left_thigh", "right_thigh"),
    "shanks": ("left_shank", "right_shank"),
}
for group, names in groups.items():
    rows = [model.bodies.index(name) for name in names]
    was_kg, estimated, kg = (x.reshape(-1, 10)[rows, 0].sum() for x in (model.known, bodies, truth))
    print(f"{group:>7}: {was_kg:.1f} kg in the model, {estimated:.1f} kg identified, {kg:.1f} kg true")

figure, panel = plt.subplots(figsize=(8, 4), layout="constrained")
figure.suptitle("Which parameters the plates tell")
prior = np.abs((was - true) / estimate.std_setup)
order = np.argsort(estimate.moved_from_prior**2)[::-1][:20]
position = np.arange(len(order))
panel.bar(position - 0.2, prior[order], 0.4, color="0.7", label="model as it came")
panel.bar(position + 0.2, np.abs((estimate.psi - true) / estimate.std_setup)[order], 0.4, label="estimate")
panel.axhline(1.96, color="black", linestyle=":", label="95 %")
panel.set_xticks(position, [estimate.base.names[k] for k in order], rotation=60)
panel.set_ylabel("error / s.d.")
panel.legend()

# Longer recordings are more informative, and each motion determines other parameters: squats the legs and the trunk,
# arm swings the arms, standing still next to nothing. In a real laboratory skin moves and plates are late; the first
# is treated as autocorrelated noise, the second is estimated ([how](../estimator.md)). Angles from other software,
# OpenSim models and C3D files are read as well: [recordings](../recordings.md), [models](../models.md).
