"""A URDF file, and what may be wrong in it: what is replaced, by what, and words of the message."""

INERTIA = '<inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0.001" ixz="-0.002" iyz="0.003"/>'
ARM = f"""<?xml version="1.0"?>
<robot name="arm">
  <material name="grey"><color rgba="1 1 1 1"/></material>
  <link name="base"/>
  <link name="upper">
    <visual><geometry><mesh filename="package://upper.stl"/></geometry></visual>
    <inertial>
      <origin xyz="0.1 0.02 -0.03" rpy="0.1 -0.2 0.3"/>
      <mass value="2.5"/>
      {INERTIA}
    </inertial>
  </link>
  <link name="fore">
    <inertial><mass value="1.5"/>{INERTIA}</inertial>
  </link>
  <link name="tool"/>
  <joint name="shoulder" type="revolute">
    <origin xyz="0 0 0.3" rpy="0 0 0.5"/>
    <parent link="base"/>
    <child link="upper"/>
    <axis xyz="0 0 1"/>
    <limit lower="-2" upper="2.5" velocity="3" effort="40"/>
    <dynamics damping="0.5" friction="0.1"/>
  </joint>
  <joint name="elbow" type="continuous">
    <origin xyz="0.4 0 0"/>
    <parent link="upper"/>
    <child link="fore"/>
    <axis xyz="0 2 0"/>
    <limit lower="9" upper="9" velocity="4" effort="inf"/>
  </joint>
  <joint name="flange" type="fixed">
    <origin xyz="0.3 0 0.01"/>
    <parent link="fore"/>
    <child link="tool"/>
  </joint>
  <transmission name="t"><type>any</type></transmission>
  <gazebo reference="upper"><kp>1</kp></gazebo>
</robot>
"""
# Every kind of joint, a coordinate that follows another's, axes and turns that are along nothing, names with dots.
RIG = f"""<?xml version="1.0" encoding="utf-8"?>
<robot name="rig" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <link name="world"/>
  <link name="cart"><inertial><origin xyz="0 0 0.1"/><mass value="3"/>{INERTIA}</inertial></link>
  <link name="bracket"><inertial><origin rpy="0.3 0 0"/><mass value="0.2"/>{INERTIA}</inertial></link>
  <link name="slide.1"><inertial><mass value="0.8"/>{INERTIA}</inertial></link>
  <link name="jaw.left"><inertial><mass value="0.1"/>{INERTIA}</inertial></link>
  <link name="jaw.right"><inertial><mass value="0.1"/>{INERTIA}</inertial></link>
  <link name="plate"><inertial><mass value="1"/>{INERTIA}</inertial></link>
  <link name="drone"><inertial><mass value="0.5"/>{INERTIA}</inertial></link>
  <joint name="cart" type="prismatic">
    <origin xyz="0 0.2 0" rpy="0 0 0.4"/><parent link="world"/><child link="cart"/><axis xyz="-1 0 0"/>
    <limit lower="0.1" upper="0.5" velocity="1" effort="1e3"/>
  </joint>
  <joint name="bolted" type="fixed">
    <origin xyz="0.1 0.2 0.3" rpy="0.4 -0.5 0.6"/><parent link="cart"/><child link="bracket"/>
  </joint>
  <joint name="lift" type="prismatic">
    <origin xyz="0 0 0.2" rpy="0.1 0.2 0.3"/><parent link="bracket"/><child link="slide.1"/><axis xyz="1 2 3"/>
    <limit lower="-1" upper="1" velocity="1" effort="1000"/><dynamics damping="2"/>
  </joint>
  <joint name="grip" type="revolute">
    <origin xyz="0.05 0 0"/><parent link="slide.1"/><child link="jaw.left"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="0.8" velocity="1" effort="5"/>
  </joint>
  <joint name="follow" type="revolute">
    <origin xyz="-0.05 0 0"/><parent link="slide.1"/><child link="jaw.right"/><axis xyz="0 -1 0"/>
    <limit lower="0" upper="0.8" velocity="1" effort="5"/><mimic joint="grip" multiplier="1" offset="0"/>
  </joint>
  <joint name="table" type="planar">
    <origin xyz="1 0 0"/><parent link="world"/><child link="plate"/><axis xyz="0 1 1"/>
  </joint>
  <joint name="flight" type="floating"><parent link="world"/><child link="drone"/></joint>
</robot>
"""


MASSLESS = '<link name="hand"/><joint name="wrist" type="revolute"><parent link="fore"/><child link="hand"/></joint>'
SECOND = '<joint name="second" type="fixed"><parent link="base"/><child link="fore"/></joint>'
CIRCLE = (
    '<link name="p"/><link name="q"/><joint name="pq" type="fixed"><parent link="p"/><child link="q"/></joint>'
    '<joint name="qp" type="fixed"><parent link="q"/><child link="p"/></joint>'
)
ZERO = '<inertia ixx="0" iyy="0" izz="0"/>'
MIRROR = '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0.05" ixz="0" iyz="0"/>'
END = "</robot>"
MASS, AXIS, ORIGIN = '<mass value="1.5"/>', '<axis xyz="0 2 0"/>', '<origin xyz="0.4 0 0"/>'
BAD = {
    "an unknown kind": ('type="continuous"', 'type="continous"', "line 25: joint `elbow` has the type 'continous'"),
    "a kind that is missing": (
        'name="elbow" type="continuous"',
        'name="elbow"',
        "joint `elbow` lacks the attribute `type`",
    ),
    "no parent": ('<parent link="upper"/>', "", 'joint `elbow` lacks <parent>. Add one, as <parent link="base"/>'),
    "no child": ('<child link="fore"/>', "", "joint `elbow` lacks <child>"),
    "a parent without link": (
        '<parent link="upper"/>',
        "<parent/>",
        "joint `elbow` lacks the attribute `link` of <parent>",
    ),
    "two parents": (
        '<parent link="upper"/>',
        '<parent link="upper"/><parent link="base"/>',
        "joint `elbow` has 2 <parent>",
    ),
    "an unknown link": (
        '<parent link="upper"/>',
        '<parent link="uper"/>',
        "`elbow`: there is no link `uper` to be its parent. Did you mean `upper`?",
    ),
    "an unknown child": ('<child link="fore"/>', '<child link="four"/>', "there is no link `four` to be its child"),
    "a joint of a link with itself": (
        '<child link="fore"/>',
        '<child link="upper"/>',
        "joint `elbow` has the link `upper` as parent and as child",
    ),
    "a loop": (END, SECOND + END, "joint `second` closes a loop: the link `fore` hangs on joint `elbow` (line 25)"),
    "two roots": (END, '<link name="loose"/>' + END, "2 links hang on no joint: `base` (line 4), `loose` (line 39)"),
    "a circle beside": (
        END,
        CIRCLE + END,
        "link `p` (line 39) does not hang on `base`: joints `pq`, `qp` go round in a circle",
    ),
    "no root": (
        END,
        '<joint name="back" type="fixed"><parent link="tool"/><child link="base"/></joint>' + END,
        "no link is the root: joints",
    ),
    "no links": (ARM, "<robot name='r'></robot>", "the robot has no <link>"),
    "a link twice": (
        '<link name="tool"/>',
        '<link name="tool"/><link name="fore"/>',
        "lines 13 and 16: two links are called `fore`",
    ),
    "a joint twice": ('name="flange"', 'name="elbow"', "lines 25 and 32: two joints are called `elbow`"),
    "a link without a name": ('<link name="tool"/>', "<link/>", "line 16: link lacks the attribute `name`"),
    "an empty name": ('<link name="tool"/>', '<link name=" "/>', "`name` of <link> must be a text of 1 to"),
    "a negative mass": (MASS, '<mass value="-1.5"/>', "link `fore`: its mass must not be negative, but it is -1.5 kg"),
    "no mass": (MASS, "", "link `fore` lacks <mass>. Add one"),
    "inertia without mass": (
        MASS,
        '<mass value="0"/>',
        "link `fore` (with 1 link fixed to it) has inertia without mass",
    ),
    "a zero inertia": (
        f"{MASS}{INERTIA}",
        MASS + ZERO,
        "line 25: joint `elbow` can move without moving any mass. Give the link `fore`",
    ),
    "a negative inertia": (
        f"{MASS}{INERTIA}",
        MASS + MIRROR,
        "link `fore` (with 1 link fixed to it): no body has its principal moments of inertia -0.04, 0.01 and 0.06",
    ),
    "an inertia that lacks a moment": ('izz="0.04"', "", "lacks the attribute `izz` of <inertia>"),
    "a slip in an inertia": (
        'ixy="0.001"',
        'iyx="0.001"',
        "link `upper`: <inertia> has an attribute `iyx`, which is not known. Did you mean `iyz`",
    ),
    "a hand of nothing": (END, MASSLESS + END, "joint `wrist` can move without moving any mass. Give the link `hand`"),
    "a zero axis": (AXIS, '<axis xyz="0 0 0"/>', "joint `elbow`: its <axis> must have a direction"),
    "an axis of two": (
        AXIS,
        '<axis xyz="0 2"/>',
        "`xyz` of <axis> must be 3 numbers with spaces between them, but it is '0 2'",
    ),
    "not a number": (
        ORIGIN,
        '<origin xyz="nan 0 0"/>',
        "`xyz` of <origin> must be written as plain decimal numbers, but it holds 'nan'",
    ),
    "an infinite place": (ORIGIN, '<origin xyz="1e999 0 0"/>', "must be finite and below 1e+100, but it holds '1e999'"),
    "a comma": (ORIGIN, '<origin xyz="0,4 0 0"/>', "has a comma in its number: '0,4'. Write a decimal point: 0.4"),
    "an underscore": (ORIGIN, '<origin xyz="1_0 0 0"/>', "but it holds '1_0'"),
    "foreign digits": (ORIGIN, '<origin xyz="٣ 0 0"/>', "plain decimal numbers"),
    "an expression": (ORIGIN, '<origin xyz="0.2*2 0 0"/>', "but it holds '0.2*2'"),
    "a place of 5000 digits": (ORIGIN, f'<origin xyz="{"1" * 5000} 0 0"/>', "`xyz` of <origin> must be a text of 1 to"),
    "a quaternion": (
        ORIGIN,
        '<origin xyz="0.4 0 0" quat_xyzw="0 0 0 1"/>',
        "joint `elbow`: <origin> has an attribute `quat_xyzw`, which is not known",
    ),
    "limits": (
        "<limit lower",
        "<limits lower",
        "joint `shoulder` holds <limits>, which is no known element. Did you mean `limit`",
    ),
    "a mistyped tag": (
        f"<inertial>{MASS}{INERTIA}</inertial>",
        f"<inertal>{MASS}{INERTIA}</inertal>",
        "link `fore` holds <inertal>",
    ),
    "a mistyped link": ('<link name="tool"/>', '<Link name="tool"/>', "the robot holds <Link>"),
    "a limit that is no number": ('velocity="3"', 'velocity="fast"', "`velocity` of <limit> must be written as"),
    "a negative damping": (
        'damping="0.5"',
        'damping="-0.5"',
        "joint `shoulder`: its damping must be at least 0, but it is -0.5",
    ),
    "a negative friction": ('friction="0.1"', 'friction="-0.1"', "its friction must be at least 0"),
    "mimic of itself": (AXIS, AXIS + '<mimic joint="elbow"/>', "joint `elbow` mimics itself"),
    "macros": (
        '<link name="tool"/>',
        '<xacro:include xmlns:xacro="http://ros.org/wiki/xacro" filename="tool"/>',
        "line 16: <xacro:include> is a macro, not yet a robot. Install xacro (`pip install xacro`)",
    ),
    "an unexpanded number": (ORIGIN, '<origin xyz="${length} 0 0"/>', "'${length} 0 0' is to be expanded by xacro"),
    "another root element": (ARM, '<sdf version="1.9"/>', "must hold a <robot>, but it holds a <sdf>"),
}


def link(name, inertial=f"<inertial>{MASS}{INERTIA}</inertial>"):
    return f'<link name="{name}">{inertial}</link>'


def hinge(name, parent, child, axis, xyz="0 0 0", kind="continuous"):
    return (
        f'<joint name="{name}" type="{kind}"><origin xyz="{xyz}"/><parent link="{parent}"/><child link="{child}"/>'
        f'<axis xyz="{axis}"/></joint>'
    )


def robot(*parts):
    return f"<robot name='r'>{''.join(parts)}</robot>"
