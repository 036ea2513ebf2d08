"""All that knows the compiler: XLA's fusion, JAX's internals, programs that are kept between processes.

- What a program computes once: `once` reads a program and sets barriers; `barriers` sets them by hand; `alike` lets
  what is alike stand once.
- How a program runs: `one_function` (a CPU runs a solve as one compiled function), `lane_axis` (lanes are the last
  axis), `platforms` (another program on a GPU), `solo` (quick compiling of a single motion).
- What is kept: `kept` (executables), by a key of `shapes`, `structure`, `library` and `code`, and small answers, in
  `files`.
- What is private in JAX and equinox is used in `private` only, JAX's own cache among it.
"""
