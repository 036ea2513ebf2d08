"""A second simulator of mechanisms with play, which shares nothing with the library but the scene file.

It is written from the pages `docs/joints.md`, `docs/laws.md`, `docs/couplings.md`, `docs/backlash.md` and
`docs/reference/scene.md`. Where the library has joint coordinates, reactions by closed recursions and error control of
its own, this one has redundant Cartesian coordinates, Lagrange multipliers, and scipy's DOP853 at a tight tolerance,
restarted wherever a contact begins, ends or starts to pull. It is slow and short.

`scenes` makes random scenes that cross features in pairs, `compare` solves each by both.
"""
