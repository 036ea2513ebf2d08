"""What pictures show of a clearance joint, in one form for all kinds."""

from typing import Any, NamedTuple


class JointOutline(NamedTuple):
    """The numbers of a joint that its pictures need, in the axes of its sleeve [m]. Datasets keep them.

    - `radius` of the pin or ball, and its `clearance`.
    - `depth`: how much farther away the wall is (by wear, for example), shape (sectors,) or (heights, sectors): the
      first sector in the direction of the sleeve's x, the others evenly around it. `None`: the wall is round.
    - `length` of a pin or a block that tilts, and `heights` along the sleeve at which it may touch; `edges`: whether
      the joint's `pattern` distinguishes edges, as that of a sleeve.
    - `through`: whether the sleeve is as long as `length`, or the pin.
    - `axial`: the play along the sleeve, with the radius `collar` at which faces bear, at `ring` points.
    - `height` and `width` of a block between flat walls (`width=None`: the walls hold it). Its `radius` is half the
      height. `height=None`: it is round.
    - `ball`: whether it is a ball in a socket.
    """

    radius: Any
    clearance: Any
    depth: Any = None
    length: Any = None
    heights: Any = (0.0,)
    edges: bool = False
    through: bool = True
    axial: Any = None
    collar: Any = 0.0
    ring: int = 0
    height: Any = None
    width: Any = None
    ball: bool = False
