"""All that knows the compiler: XLA's fusion, JAX's internals, programs that are kept between processes.

- What a program computes once: `once` reads a program and sets barriers; `barriers` sets them by hand; `alike` lets
  what is alike stand once. A program that `once` reads needs none by hand. Those that stand in the physics serve
  batches: a batch of 64 motions takes longer without (least of several runs in turn, one core): in `laws/_friction`
  15 % (the tool changer of the experiments), in `joints/_base` 6 % (slider-crank; `share`) and 4 % (tool changer;
  normal forces), in `joints/sleeve` 5 % (tool changer), in `joints/bore` 9 % (worn disc).
- How a program runs: `one_function` (a CPU runs a solve as one compiled function), `lane_axis` (lanes are the last
  axis), `platforms` (another program on a GPU), `solo` (quick compiling of a single motion).
- What is kept: `kept` (executables), by a key of `shapes`, `structure`, `library` and `code`, and small answers, in
  `files`.
- What is private in JAX and equinox is used in `private` only, JAX's own cache among it.
"""
