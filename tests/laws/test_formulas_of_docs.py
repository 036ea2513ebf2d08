"""Every formula of a law, on the page of the laws and in its docstring (of which the reference of scene files is made),
has the values of the code: force, traction, rate of the memory.
"""

import inspect
import re
from typing import Any

import catalogue
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from formulas import Equations, NoFormulaError, of_docstring, of_page
from places import ROOT

from clearance_jax import laws
from clearance_jax.laws.normal import ratios, relations

PAGE = (ROOT / "docs" / "laws.md").read_text(encoding="utf-8")
C, R_I, R_J, LENGTH = 5e-4, 0.0105, 0.01, 0.02
GEOMETRY = laws.Geometry(*(jnp.asarray(x) for x in (R_J, R_I, C, LENGTH)))
IMPACT_SPEED, FLOW = 0.3, 8e-6
DEPTHS = np.array([1e-7, 2e-6, 7e-6, 1.5e-5, 1e-4])
RATES = np.array([-0.6, -0.05, 0.0, 0.4])
D, RATE = (x.ravel() for x in np.meshgrid(DEPTHS, RATES))
SLIPS = np.array([1e-7, 3e-4, 9e-4, 1.2e-3, 7e-3, 1e-2, 1.3e-2, 0.2])
LOAD = 120.0
E_STAR = 2.07e11 / 2 / (1 - 0.3**2)
LINE = {"c": C, "R": R_I, "L": LENGTH, "E_star": E_STAR}
MILLIMETRES = {"c": 1e3 * C, "L": 1e3 * LENGTH, "R_i": 1e3 * R_I, "R_j": 1e3 * R_J, "E_star": 1e-6 * E_STAR}
MEMBERS = ["exact-restitution", "hunt-crossley-1975", "herbert-mcwhannell", "lee-wang", "lankarani-nikravesh"]
MEMBERS += ["gonthier", "zhiying-qishao", "flores", "hu-guo", "gharib-hurmuzlu"]

# What the numbers of the catalogue's laws are called in the formulas.
NORMAL: dict[str, dict[str, Any]] = {
    "hertz": {"K": 6.61e10, "n": 1.5},
    "hunt-crossley": {"K": 6.61e10, "n": 1.5, "lambda": 0.5},
    "adams-impact": {"K": 6.61e10, "n": 1.5, "c_max": 2000.0, "d_max": 1e-5},
    "kelvin-voigt": {"k": 1e7, "b": 500.0},
    "tsuji": {"K": 6.61e10, "e": 0.7, "m": 0.14},
    "anagnostopoulos": {"k": 1e7, "K": 1e7, "e": 0.7, "m": 0.14},
    "standard-linear-solid": {"K": 1e7, "g": 0.4, "T": 5e-3, "n": 1.0},
    "johnson": {**LINE, "B": -1.0},
    "radzimovsky": {**LINE, "B": 2 / 3 - np.log(4), "R_i": R_I, "R_j": R_J},
    "esdu-78035": {**LINE, "B": 1.0},
    "liu": LINE,
    "bai-zhao": {**LINE, "e": 0.7},
    "pereira": {**MILLIMETRES, "e": 0.7},
    "goldsmith": {**MILLIMETRES, "m": 1},
    "dubowsky-freudenstein": {**MILLIMETRES, "m": 3},
    "winkler": {"k": 2e13, "c": C, "R": R_I, "L": LENGTH},
    **{name: {"K": 6.61e10, "n": 1.5, "e": 0.7, "v_0": IMPACT_SPEED, "v0": IMPACT_SPEED} for name in MEMBERS},
}
STRIBECK = {"mu_s": 0.4, "v_s": 1e-3}
BRISTLES = {"sigma_0": 1e5, "s0": 1e5, "sigma_1": 1e-2, "s1": 1e-2, "sigma_2": 0.0, "s2": 0.0}
FRICTION: dict[str, dict[str, Any]] = {
    "cubic": {"mu": 0.3, "v_c": 1e-2},
    "tanh": {"mu": 0.3, "v_t": 1e-2},
    "brown-mcphee": {"mu_s": 0.4, "mu_d": 0.3, "v_t": 1e-2},
    "lugre": {**STRIBECK, **BRISTLES, "mu_k": 0.3},
    "adams": {**STRIBECK, "mu_d": 0.3, "v_d": 1e-2},
    "threlfall": {"mu": 0.3, "v_r": 1e-2},
    "ambrosio": {"mu": 0.3, "v_0": 1e-3, "v_1": 1e-2},
    "bengisu-akay": {"mu_s": 0.4, "mu_d": 0.3, "v_0": 1e-2, "v_1": 5e-3},
    "stribeck": {**STRIBECK, "mu_d": 0.3, "v_t": 1e-2, "p": 2.0, "k": 0.0},
    "dahl": {**BRISTLES, "mu": 0.3},
    "elasto-plastic": {**STRIBECK, **BRISTLES, "mu_k": 0.3, "b": 0.5},
}
# What a paragraph says by reference to another one.
LUGRE = r"$T = -N (\sigma_0 z + \sigma_1 \dot z + \sigma_2 v)$, $g = \mu_k + (\mu_s - \mu_k) \exp(-(v/v_s)^2)$"
# Penetrations in mm, forces over the length in N/mm.
IN_MILLIMETRES = ("pereira", "goldsmith", "dubowsky-freudenstein")


def paragraph(name: str) -> str:
    """What the page says of a law."""
    found = re.search(rf"^(?:`[\w-]+`, )*`{name}`(?:, `[\w-]+`)*\n: (.*?)(?=\n\n\S)", PAGE, re.MULTILINE | re.DOTALL)
    assert found, f"the page has no paragraph of `{name}`"
    return found[1]


def exponent(c: float) -> float:
    """Y of the law of Pereira, for a clearance in mm."""
    return float(Equations([one for one in of_page(paragraph("pereira")) if one[0] == "Y"], {"c": c}, True)("Y"))


def summary(name: str) -> str:
    """What the reference of scene files says of a law: the first paragraph of its docstring."""
    made = laws.NORMAL_LAWS.get(name) or laws.FRICTION_LAWS[name]
    return re.split(r"\n\n|\*\*Arguments", inspect.getdoc(made) or "")[0]


def check_normal(name: str, equations: list[tuple[str, str]], whole: bool) -> Equations:
    """The force, and the rate of the memory, of every state are those of the equations."""
    law: Any = catalogue.NORMAL[name]
    ready, apart = law.prepare(GEOMETRY), law.acts_apart
    memory = tuple(jnp.asarray(FLOW if apart else IMPACT_SPEED) for _ in law.remembers)
    # Beyond its limit a logarithm goes on along its tangent.
    inside = float(law.validity(ready.constants)) if name in ("johnson", "radzimovsky", "esdu-78035") else np.inf
    inside = 4e-6 if "m" in NORMAL[name] and name in IN_MILLIMETRES else inside
    depths, rates = (x[inside > D] for x in (D, RATE))
    depths, rates = (np.append(x, more) for x, more in ((depths, [-1e-6] * apart), (rates, [0.1] * apart)))
    force = np.asarray(jax.vmap(lambda d, v: ready.force(d, v, memory))(jnp.asarray(depths), jnp.asarray(rates)))
    scale = 1e3 if name in IN_MILLIMETRES else 1.0
    state = {"d": scale * depths, "d'": rates}
    # What is said of the elastic force alone holds for that of the law at rest.
    still = tuple(jnp.asarray(IMPACT_SPEED) for _ in law.remembers)
    elastic = np.asarray(jax.vmap(lambda d: ready.force(d, jnp.zeros(()), still))(jnp.asarray(depths))) / LENGTH
    told = {left for left, _ in equations}
    if apart:
        state["z"] = FLOW
    if "F'" not in told:
        state["F'"] = elastic / scale
    from_page = Equations(equations, {**NORMAL[name], **state}, whole)
    size = np.abs(force) + 1e-9 * np.max(np.abs(force))
    checked = 0
    if "F" in from_page.definitions:
        assert np.all(np.abs(from_page("F") - force) <= 1e-9 * size), name
        checked += 1
    if "F'" in from_page.definitions:
        np.testing.assert_allclose(from_page("F'"), elastic / scale, rtol=1e-9, err_msg=name)
        checked += 1
        if "a" in from_page.definitions:
            damped = elastic * LENGTH * np.maximum(0, 1 + from_page("a") * rates / IMPACT_SPEED)
            assert np.all(np.abs(damped - force) <= 1e-9 * size), name
    if "kappa" in from_page.definitions:
        lever = jax.vmap(lambda d: law.friction_lever(ready.constants, d))(jnp.asarray(depths))
        np.testing.assert_allclose(R_J * (from_page("kappa") - 1) + depths, lever, rtol=1e-6)
    if apart:
        rate = jax.vmap(lambda d, v: ready.memory_rate(d, v, memory)[0])(jnp.asarray(depths), jnp.asarray(rates))
        np.testing.assert_allclose(from_page("z'"), rate, rtol=1e-12, atol=1e-12)
    checked += from_page.check(1e-8)
    assert checked, f"nothing is said of the force of `{name}`"
    return from_page


@pytest.mark.parametrize("name", laws.NORMAL_LAWS)
def test_normal_laws_of_the_page(name):
    text = paragraph(name)
    if name in MEMBERS:
        text, (ratio,) = text.partition("| law |")[0], re.findall(rf"`{name}` \| ([^|]*) \|", text)
        ratio = ratio.strip("$") if ratio.startswith("$") else None
        text += r" $a (1 + e) = \ln \frac{1 + a}{1 - a e}$" if ratio is None else f" $a(e) = {ratio}$"
        if ratio is None:
            assert r"root of $a (1 + e) = \ln \frac{1 + a}{1 - a e}$" in paragraph(name)
            NORMAL[name] = {**NORMAL[name], "a": float(ratios.exact_ratio(jnp.asarray(0.7)))}
    equations = list(of_page(text.partition("With $\\zeta")[0]))
    found = check_normal(name, equations, whole=True)
    assert found.used == set(found.definitions), "a formula of the page is not tested"


@pytest.mark.parametrize("name", laws.NORMAL_LAWS)
def test_normal_laws_of_the_reference(name):
    if name in MEMBERS:
        law: Any = catalogue.NORMAL[name]
        text = str(inspect.getdoc(laws.RestitutionLaw)).partition("\n\n")[0]
        told = Equations(list(of_docstring(law.ratio.__doc__.replace("A =", "a ="))), {"e": 0.7}, False)
        a = float(law.ratio(jnp.asarray(0.7)))
        if name != "exact-restitution":
            assert float(told("a")) == pytest.approx(a, rel=1e-12)
        numbers, equations = {**NORMAL[name], "a": a}, list(of_docstring(text.replace("with a = ratio(e)", "")))
        NORMAL[name] = numbers
        check_normal(name, equations, whole=False)
        return
    text = summary(name).replace("1/R = 1/R_j - 1/R_i", "R = 1/(1/R_j - 1/R_i)")
    text = text.replace("cos t = c/e", "t = arccos(c/e)")
    known = NORMAL[name]
    if name == "pereira":
        known = NORMAL[name] = {**known, "Y": exponent(1e3 * C)}
    if name == "radzimovsky":
        known = NORMAL[name] = {key: value for key, value in known.items() if key != "R"}
    equations = [(left, right) for left, right in of_docstring(text) if left not in known or left == "d"]
    check_normal(name, equations, whole=False)


def test_restitutions_of_the_page():
    """Of a spring and damper; the series of Hunt and Crossley's law."""
    first, second = paragraph("kelvin-voigt").partition("With $\\zeta")[2].split("and without the cut")
    first = "$\\zeta" + first
    for damping in (50.0, 900.0):
        for told, clipped in ((first, True), (first.rpartition("an impact")[0] + second, False)):
            e = Equations(list(of_page(told)), {"b": damping, "k": 1e7, "m": 0.14}, True)("e")
            law = laws.LinearKelvinVoigt(1e7, damping, clipped=clipped)
            assert float(law.delivered_restitution(mass=0.14)) == pytest.approx(float(e), rel=1e-12)
    (series,) = re.findall(r"\$(e = [^$]*) - \\dots\$", paragraph("hunt-crossley"))
    e = Equations(list(of_page(f"${series}$")), {"lambda": 0.5, "v": 2e-3}, True)("e")
    assert float(laws.HuntCrossley(1e10, 0.5).delivered_restitution(2e-3)) == pytest.approx(float(e), abs=1e-9)


def test_the_moment_of_friction_of_line_contacts():
    (text,) = re.findall(r"^Friction acts all over the patch.*?(?=\n\n)", PAGE, re.MULTILINE | re.DOTALL)
    law = laws.johnson(2.07e11, 2.07e11)
    ready, depths = law.prepare(GEOMETRY), jnp.asarray(DEPTHS)
    force = jax.vmap(lambda d: ready.force(d, jnp.zeros(()), ()))(depths)
    found = Equations(list(of_page(text)), {**LINE, "F'": np.asarray(force) / LENGTH}, True)
    lever = jax.vmap(lambda d: law.friction_lever(ready.constants, d))(depths)
    np.testing.assert_allclose(R_J * (found("kappa") - 1), lever, rtol=1e-8)
    assert found.used == set(found.definitions)


def test_the_exponent_of_pereira_on_both_sides():
    for clearance in (2e-5, 5e-4):
        line = relations.ContactLine(*(jnp.asarray(x) for x in (clearance, R_J, R_I, LENGTH, E_STAR)))
        n = exponent(1e3 * clearance) * (1e3 * clearance) ** -0.005
        assert float(relations._pereira_numbers(line)[1]) == pytest.approx(n, rel=1e-12)


def check_friction(name: str, equations: list[tuple[str, str]], whole: bool) -> Equations:
    """The traction, and the rate of the bristles, of every slip are those of the equations."""
    law: Any = catalogue.FRICTION[name]
    ready, load = law.prepare(GEOMETRY), jnp.asarray(LOAD)
    state: dict[str, Any] = {"v": SLIPS, "N": LOAD}
    bends = np.zeros(SLIPS.shape)
    if law.bristles:
        # Either way, below and above what a bristle bends at most.
        slips, bends = (x.ravel() for x in np.meshgrid([*SLIPS, *-SLIPS], [-3.9e-6, -2.4e-6, 1e-7, 3.1e-6]))
        state |= {"v": slips, "z": bends}

    def asked(v, z):
        memory = (z,) if law.bristles else ()
        rate = ready.memory_rate((v,), load, memory)
        return ready.traction((v,), load, memory)[0], rate[0] if rate else v

    traction, rate = (np.asarray(x) for x in jax.vmap(asked)(jnp.asarray(state["v"]), jnp.asarray(bends)))
    found = Equations(equations, {**FRICTION[name], **state}, whole)
    np.testing.assert_allclose(found("T"), traction, rtol=1e-11, err_msg=name)
    if law.bristles:
        np.testing.assert_allclose(found("z'"), rate, rtol=1e-11, atol=1e-15, err_msg=name)
    found.check(1e-11)
    return found


@pytest.mark.parametrize("name", laws.FRICTION_LAWS)
def test_friction_laws_of_the_page(name):
    text = paragraph(name)
    if name == "elasto-plastic":
        text, alpha = text + LUGRE, "alpha"
        text = text.replace(r"\alpha", alpha)
        assert set(of_page(LUGRE)) <= set(of_page(paragraph("lugre")))
    found = check_friction(name, list(of_page(text)), whole=True)
    assert found.used == set(found.definitions), "a formula of the page is not tested"


@pytest.mark.parametrize("name", laws.FRICTION_LAWS)
def test_friction_laws_of_the_reference(name):
    text = summary(name) + (summary("lugre").replace("z' = v -", "") if name == "elasto-plastic" else "")
    check_friction(name, list(of_docstring(text)), whole=False)


def test_corners_are_rounded_by_the_polynomials_of_the_page():
    """With the jumps of the law of Ambrosio, whose corners are far from each other; and |v| of bristles."""
    section = PAGE.partition("### Friction without corners")[2].partition("\n## ")[0]
    added, size = (f"${span}$" for span in re.findall(r"\$([^$]*\(w - \|[^$]*)\$", section))
    law, width = laws.Ambrosio(0.3, 1e-3, 1e-2), 5e-4
    for speed, jump in ((1e-3, 0.3 / 9e-3), (1e-2, -0.3 / 9e-3)):
        x = np.linspace(-0.9, 0.9, 7) * width
        slips = jnp.asarray(speed + x)
        smooth, sharp = (
            np.asarray(jax.vmap(lambda v, one=one: one.prepare(GEOMETRY).traction((v,), jnp.ones(()), ())[0])(slips))
            for one in (law.smoothed(width), law)
        )
        found = Equations([*of_page(added.replace("$", "$y = ", 1))], {"j": jump, "k": 0.0, "w": width, "x": x}, True)
        np.testing.assert_allclose(found("y"), sharp - smooth, atol=1e-14)
    v = np.linspace(-0.9, 0.9, 7) * width
    found = Equations([*of_page(size.replace("$", "$y = ", 1))], {"w": width, "v": v}, True)
    one, rounded = jnp.ones(()), laws.Dahl(0.3, 1e5).smoothed(width).prepare(GEOMETRY)
    rates = jax.vmap(lambda s: rounded.memory_rate((s,), one, (1e-6 * one,))[0])
    np.testing.assert_allclose(v - 1e5 * found("y") * 1e-6 / 0.3, rates(jnp.asarray(v)), rtol=1e-10, atol=1e-15)


def test_the_reader_of_formulas():
    """It reads products, powers and sizes as they are meant, and finds what is wrong."""
    known = {"a": 2.0, "b": 3.0, "c": -5.0, "x_1": 0.5}
    for text, value in (
        (r"a b^2 / 4 c", -22.5), (r"\frac{a}{b} |c| a", 20 / 3), (r"-a^2", -4.0), (r"a^{-1} \sqrt{b + 1}", 1.0),
        (r"\max(0, c)^{a} + |a - b|", 1.0), (r"\begin{cases} a & x_1 \le 1 \\ b & x_1 > 1 \end{cases}", 2.0),
        (r"\sin x_1 \cos x_1", np.sin(1) / 2), (r"\mathrm{STEP}(x_1, 0, 1, 1, b)", 2.0),
    ):  # fmt: skip
        assert float(Equations(list(of_page(f"$y = {text}$")), known, True)("y")) == pytest.approx(value), text
    for text in ("a q", "a +", "(a"):
        with pytest.raises(NoFormulaError):
            Equations(list(of_page(f"$y = {text}$")), known, True)
    wrong = paragraph("hertz").replace("K d^{n}", "K d^{n + 1}")
    with pytest.raises(AssertionError):
        check_normal("hertz", list(of_page(wrong)), True)
