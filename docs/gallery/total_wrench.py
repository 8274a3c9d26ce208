# # The total wrench of two contacts
#
# A pad and a hand take part of the load; together with the ground's moment theirs is the one that the motion requires.

import matplotlib.pyplot as plt
import numpy as np

import multicontact as mc
from sim.motion.excitation import DOUBLE_PENDULUM

spec = mc.scenes.load("double_pendulum", contact="pad handle")
pendulum = mc.mechanism(spec, base="base")
recording = mc.simulate(spec, DOUBLE_PENDULUM, samples=600)
sensors = {name: mc.Sensor(*pendulum.sites[name], applied_to_link=False) for name in ("contact_pad", "contact_handle")}
recording = recording.with_sensors(sensors)
states = recording.joint_states(pendulum.tree.joints)
required = mc.base_wrench_regressor(pendulum.tree, *states, gravity=pendulum.gravity) @ pendulum.known
without = {
    "ground alone": ("contact_pad", "contact_handle"),
    "ground and pad": ("contact_handle",),
    "ground, pad and hand": (),
}

figure, panel = plt.subplots(figsize=(6, 4), layout="constrained")
figure.suptitle("Moment at the base with more and more contacts")
for (label, names), color in zip(without.items(), ("C1", "C2", "black"), strict=True):
    total = recording.total_wrench(pendulum.tree, names).values
    panel.plot(recording.time, total[:, 3], color=color, lw=2 if not names else 1.2, label=label)
panel.plot(recording.time, required[:, 3], "--", color="C0", lw=1.2, label="required by the motion, $Y\\varphi$")
panel.set(xlabel="time (s)", ylabel=r"$\tau_x$ (N m)")
figure.legend(loc="outside lower center", ncols=2)
print(f"largest difference {np.abs(total - required).max():.1f} N or N m with all contacts")
