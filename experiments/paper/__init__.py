"""Qian et al. 2022 (Appl. Sci. 12(21), 11041, doi 10.3390/app122111041), reproduced: `python -m experiments.paper`.

The paper studies a tool-changing robot with clearance in one joint, joint 5. Its figures 6 to 13 show simulations, and
its text draws conclusions from them. Here joint 5 alone in the plane (`joint5_velocity_1.toml`) and the whole robot in
space (`tool_changer.toml`) are solved under the conditions of those figures, and every claim is tested.

What the paper prints: radii and materials of pin and sleeve, K and D of Table 1, Eqs. 6 to 8, the drives of Table 2,
clearances of 0.1, 0.2 and 1 mm, coefficients of friction 0.3 and 0.5, and two numbers of its curves: a largest speed of
832.2885 mm/s and a largest acceleration of 10218.89 mm/s². The other values of its curves are shown in pictures only.

What cannot be known: the masses of the robot and of what it carries (but for a cutter of "about more than 300 kg"), its
lengths, where the end-marked point lies, in which posture it starts, the initial velocities of the pin in its sleeve,
the sleeve's length and axial play, the transition speed of friction, and the integrator's tolerances. The scenes assume
them, and say so: 300 kg at 176.62 mm from joint 5. This radius was chosen such that Velocity_1 gives the printed speed.
So the agreement of this speed proves nothing. The pin starts at rest in the middle of its sleeve, as in the paper, in a
robot that holds its arm out level.

If the paper contradicts itself, both readings are solved. Damping is that of Eq. 7 (ADAMS IMPACT), or that of Table 1
(D = 1.543e6 d^1.5 / d'0, as Lankarani and Nikravesh have it for e = 0.416). "0.1 mm" is the radial clearance, as Eq. 1
defines it, or the diametral one, as the radii of Table 1 have it. Velocity_4 ends at 8 s, or at 9 s, as the durations
of the other drives suggest. The literal reading is Eq. 7, radial, 8 s. Wear, Figs. 14 and 15, is in [Paper
wear](paper_wear.md).
"""
