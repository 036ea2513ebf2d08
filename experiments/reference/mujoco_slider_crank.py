"""The slider-crank in MuJoCo: ideal, and with play in its piston pin. Nothing here imports the library.

MuJoCo has no prescribed motion: the crank turns freely with an inertia (`armature`) so large that the mechanism does
not slow it. The ideal pin is an equality constraint ("connect"). Play is a limit: a tendon from the conrod's end to the
slider's pin is no longer than the clearance. Both are MuJoCo's soft constraints, with a time constant of
`STIFFNESS` steps and critical damping; there is no Hertz stiffness, no damping by depth, and no friction in it.
"""

import numpy as np

from experiments.reference.problems import slider_crank_parameters

ARMATURE = 1e4
# MuJoCo asks for a time constant of two steps at least.
STIFFNESS = 4

TEXT = """
<mujoco>
  <compiler angle="radian" inertiafromgeom="false"/>
  <option timestep="{step!r}" gravity="0 0 0" integrator="Euler" iterations="200" tolerance="1e-14" cone="elliptic">
    <flag contact="disable"/>
  </option>
  <worldbody>
    <body name="crank">
      <joint name="main" type="hinge" axis="0 0 1" armature="{armature!r}"/>
      <inertial pos="0.025 0 0" mass="0.3" diaginertia="1e-4 1e-4 1e-4"/>
      <body name="rod" pos="{crank!r} 0 0">
        <joint name="crankpin" type="hinge" axis="0 0 1"/>
        <inertial pos="{half!r} 0 0" mass="{rod_mass!r}" diaginertia="{rod_inertia!r} {rod_inertia!r} {rod_inertia!r}"/>
        <site name="sleeve" pos="{rod!r} 0 0"/>
      </body>
    </body>
    <body name="slider" pos="{stretched!r} 0 0">
      <joint name="guide" type="slide" axis="1 0 0"/>
      <inertial pos="0 0 0" mass="{slider_mass!r}" diaginertia="1e-5 1e-5 1e-5"/>
      <site name="pin"/>
    </body>
  </worldbody>
  {hold}
</mujoco>
"""
CONNECTED = (
    """<equality><connect site1="sleeve" site2="pin" solref="{soft!r} 1" solimp="0.9999 0.9999 1"/></equality>"""
)
LIMITED = """<tendon><spatial name="play" limited="true" range="0 {clearance!r}" solreflimit="{soft!r} 1"
  solimplimit="0.9999 0.9999 1"><site site="sleeve"/><site site="pin"/></spatial></tendon>"""


def simulate(clearance: float, t1: float, step: float, samples: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times [s], the slider's positions [m] and the eccentricities of its pin [m] at so many times up to `t1`. Ideal
    where the clearance is zero.
    """
    import mujoco

    speed, crank, rod, rod_mass, rod_inertia, slider_mass = slider_crank_parameters(clearance)[-6:].tolist()
    soft = STIFFNESS * step
    hold = CONNECTED.format(soft=soft) if clearance == 0 else LIMITED.format(soft=soft, clearance=clearance)
    model = mujoco.MjModel.from_xml_string(
        TEXT.format(
            step=step, armature=ARMATURE, crank=crank, rod=rod, half=rod / 2, stretched=crank + rod, hold=hold,
            rod_mass=rod_mass, rod_inertia=rod_inertia, slider_mass=slider_mass,
        )
    )  # fmt: skip
    data = mujoco.MjData(model)
    data.qvel[:] = [speed, -speed * crank / rod - speed, 0.0]
    times, places, far = [], [], []
    each = round(t1 / step / samples)
    for _ in range(samples):
        mujoco.mj_step(model, data, nstep=each)
        # Positions of sites belong to the last step's start.
        mujoco.mj_kinematics(model, data)
        times.append(data.time)
        places.append(crank + rod + data.qpos[2])
        far.append(np.linalg.norm(data.site("pin").xpos - data.site("sleeve").xpos))
    return np.array(times), np.array(places), np.array(far)
