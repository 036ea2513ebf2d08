"""What the compiler computes twice stays within bounds; and the counter counts."""

import jax
import jax.numpy as jnp
import pytest

from clearance_jax._compile.barriers import share, sharing
from experiments import operations
from experiments.hlo import busiest_loop, read

# Only a compiler that optimises computes anything twice.
pytestmark = [pytest.mark.optimised, pytest.mark.quick]

# Eight entries: a reduction of four rows (32), a product in both kernels (16), a sine (8), a barrier (0).
PROGRAM = """HloModule made_up, entry_computation_layout={(f64[4,8]{1,0})->f64[4,8]{1,0}}

%once (a: f64[8], b: f64[8]) -> f64[8] {
  %a = f64[8]{0} parameter(0)
  %b = f64[8]{0} parameter(1)
  %twice = f64[8]{0} multiply(%a, %b)
  ROOT %sine = f64[8]{0} sine(%twice), metadata={op_name="jit(f)/while/body/sin"}
}

%again (a: f64[8], b: f64[8]) -> f64[8] {
  %a = f64[8]{0} parameter(0)
  %b = f64[8]{0} parameter(1)
  %twice = f64[8]{0} multiply(%a, %b)
  ROOT %div = f64[8]{0} divide(%twice, %b), metadata={op_name="jit(f)/while/body/vmap(shared)/div"}
}

add {
  x = f64[] parameter(0)
  y = f64[] parameter(1)
  ROOT sum = f64[] add(x, y)
}

%body (state: (f64[4,8], f64[8])) -> (f64[4,8], f64[8]) {
  %state = (f64[4,8]{1,0}, f64[8]{0}) parameter(0)
  %rows = f64[4,8]{1,0} get-tuple-element(%state), index=0
  %zero = f64[] constant(0)
  %sum = f64[8]{0} reduce(%rows, %zero), dimensions={0}, to_apply=%add
  %one = f64[8]{0} fusion(%sum, /*index=1*/%sum), kind=kLoop, calls=%once
  %two = f64[8]{0} fusion(%sum, %one), kind=kLoop, calls=%again, metadata={op_name="jit(f)/vmap(shared)/div"}
  ROOT %next = (f64[4,8]{1,0}, f64[8]{0}) tuple(%rows, %two)
}

%more (state: (f64[4,8], f64[8])) -> pred[] {
  %state = (f64[4,8]{1,0}, f64[8]{0}) parameter(0)
  ROOT %yes = pred[] constant(true)
}

ENTRY %main (rows: f64[4,8]) -> (f64[4,8], f64[8]) {
  %rows = f64[4,8]{1,0} parameter(0)
  %start = f64[8]{0} constant({1, 1, 1, 1, 1, 1, 1, 1})
  %state = (f64[4,8]{1,0}, f64[8]{0}) tuple(%rows, %start)
  ROOT %loop = (f64[4,8]{1,0}, f64[8]{0}) while(%state), condition=%more, body=%body
}
"""


def test_what_stands_twice_counts_twice():
    program = read(PROGRAM)
    assert program["body"]["sum"].operands == ("rows", "zero")
    assert program["body"]["one"].called == ("once",)
    assert program["main"]["loop"].called == ("body",)
    assert busiest_loop(PROGRAM) == 32 + 16 + 8


@pytest.mark.parametrize("barriers", [0, 1])
def test_barriers_and_moves_count_nothing(barriers):
    def turn(_, x):
        x = jnp.sin(x) * 3.0
        with sharing():
            for _ in range(barriers):
                x = share(x)
        return jnp.concatenate([x[1:], x[:1]])

    lowered = jax.jit(lambda x: jax.lax.fori_loop(0, 5, turn, x)).lower(jnp.zeros(8))
    for text in (lowered.as_text(dialect="hlo", debug_info=True), lowered.compile().as_text()):
        assert busiest_loop(text) == 2 * 8 + 1  # and the loop's own counter


@pytest.mark.slow
def test_fusing_repeats_little():
    (row,) = operations.main(quick=True)
    assert 1 <= row.repeated <= 1.3
    # Nothing is gained where the program is written longer instead.
    assert row.fused <= 1.3 * row.written
