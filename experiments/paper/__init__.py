"""Qian et al. 2022 (Appl. Sci. 12(21), 11041, doi 10.3390/app122111041), reproduced: `python -m experiments.paper`.

The paper studies a tool-changing robot with clearance in one joint, joint 5. Its figures 6 to 13 show simulations, and
its text draws conclusions from them. Here two models are simulated under the conditions of those figures: joint 5 alone
in the plane (`joint5_velocity_1.toml`), and the whole robot in space (`tool_changer.toml`). Every claim is tested.

The paper prints these numbers: radii and materials of pin and sleeve, K and D of Table 1, Eqs. 6 to 8, the drives of
Table 2, clearances of 0.1, 0.2 and 1 mm, coefficients of friction 0.3 and 0.5, and two numbers of its curves: a largest
speed of 832.2885 mm/s and a largest acceleration of 10218.89 mm/s². The other values of its curves are shown in
pictures only.

The following is not known: the masses of the robot and of its load (except a cutter of "about more than 300 kg"), the
lengths of the robot, the place of its end-marked point, the posture at the start, the initial velocity of the pin in
its sleeve, the sleeve's length and axial play, the transition speed of friction, and the integrator's tolerances. The
scenes assume values for all of these. They assume a load of 300 kg at 176.62 mm from joint 5. This distance was chosen
such that Velocity_1 gives the printed speed. So the agreement of this speed proves nothing. The pin starts at rest in
the middle of its sleeve, as in the paper. The arm of the robot is horizontal.

In three places the paper contradicts itself. Then both readings are simulated. The damping is that of Eq. 7 (ADAMS
IMPACT), or that of Table 1 (D = 1.543e6 d^1.5 / d'0, which follows from the law of Lankarani and Nikravesh for e =
0.416). "0.1 mm" is the radial clearance (by Eq. 1), or the diametral one (by the radii of Table 1). Velocity_4 ends at
8 s, or at 9 s (as the durations of the other drives suggest). The literal reading is Eq. 7, radial, 8 s. Wear, Figs. 14
and 15, is in [Paper wear](paper_wear.md).
"""
