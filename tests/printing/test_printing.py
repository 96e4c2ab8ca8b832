"""Expressions as text and LaTeX: the wanted form, and the same value when Python reads it back."""

import math
import re
import time
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from matplotlib.mathtext import MathTextParser
from seeds import seeds

from mbdcasadi.errors import ModelError
from mbdcasadi.printing import matrix_to_latex, matrix_to_text, to_latex, to_text

CRANK = {name: ca.SX.sym(f"crank.{name}") for name in "x y phi vx vy omega ax ay alpha".split()}
X, PHI, OMEGA = CRANK["x"], CRANK["phi"], CRANK["omega"]
a, b, c = (ca.SX.sym(name) for name in "abc")


@pytest.mark.parametrize(
    ("expression", "text"),
    [
        (X + 0.05 * ca.cos(PHI) - 0.1, "crank.x + 0.05*cos(crank.phi) - 0.1"),
        (a - (b - c), "a - b + c"),
        (a + (b - c), "a + b - c"),
        (a - b - c, "a - b - c"),
        (-(a - b), "b - a"),
        (-a + b, "b - a"),
        (a + (-2) * b, "a - 2*b"),
        (a - (-2) * b, "a + 2*b"),
        (a - ca.SX(-2), "a + 2"),
        (-(a * b), "-a*b"),
        (a * (b + c), "a*(b + c)"),
        (a * b * c, "a*b*c"),
        (a / (b * c), "a/(b*c)"),
        (a / (b / c), "a*c/b"),
        (a / b / c, "a/(b*c)"),
        (2 * a, "2*a"),
        (1 / a, "1/a"),
        (a**2, "a**2"),
        (a**3, "a**3"),
        (a**4, "a**4"),
        (a**7, "a**7"),
        (a**-2, "1/a**2"),
        (a**1.5, "a**1.5"),
        ((a + b) ** 2, "(a + b)**2"),
        ((a * b) ** 1.5, "(a*b)**1.5"),
        (ca.SX(-2) ** a, "(-2)**a"),
        (a ** (-b), "a**(-b)"),
        ((a**b) ** c, "(a**b)**c"),
        (ca.sin(a) ** 2, "sin(a)**2"),
        (-(a**2), "-a**2"),
        (ca.sqrt(a + b), "sqrt(a + b)"),
        (ca.atan2(a, -b), "atan2(a, -b)"),
        (ca.hypot(a, b), "hypot(a, b)"),
        (a > 0, "a > 0"),
        (a <= b, "a <= b"),
        ((a > b) * c, "(b < a)*c"),
        (ca.logic_and(a > 0, ca.logic_or(b < 1, c == 2)), "a > 0 and (b < 1 or c == 2)"),
        (ca.logic_not(a > 0), "not a > 0"),
        (ca.if_else(a > 0, -b, 0), "if_else(a > 0, -b, 0)"),
        (ca.if_else(a > 0, 0, b), "if_else(a > 0, 0, b)"),
        (ca.if_else(a > 0, b, c + 1), "if_else(a > 0, b, c + 1)"),
        (ca.if_else(a, b, c), "if_else(a, b, c)"),
        (2 * ca.if_else(a > 0, b, c) - 1, "2*if_else(a > 0, b, c) - 1"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_text(expression, text):
    assert to_text(expression) == text


@pytest.mark.parametrize(
    ("expression", "text", "latex"),
    [
        # Products: one number in front, each factor once, sums at the end.
        (
            0.4 * OMEGA * ca.cos(PHI) * OMEGA,
            "0.4*cos(crank.phi)*crank.omega**2",
            r"0.4 \, \cos{\phi_{\mathrm{crank}}} \cdot \dot{\phi}_{\mathrm{crank}}^{2}",
        ),
        (a * 0.4 * (b * 0.5), "0.2*a*b", r"0.2 \, a \, b"),
        (a * (b * (a * b)) * c, "a**2*b**2*c", r"a^{2} \, b^{2} \, c"),
        (ca.cos(a) * b * ca.cos(a), "b*cos(a)**2", r"b \, \cos^{2}{a}"),
        ((2 * a * b) ** 2, "4*a**2*b**2", r"4 \, a^{2} \, b^{2}"),
        (a * (-b) * (-c), "a*b*c", r"a \, b \, c"),
        (-a * (b - c), "-a*(b - c)", r"-a \, \left(b - c\right)"),
        ((b - c) * a, "a*(b - c)", r"a \, \left(b - c\right)"),
        ((a - b) * (a - b) * (a - b), "(a - b)**3", r"\left(a - b\right)^{3}"),
        ((-a - b) * c, "-c*(a + b)", r"-c \, \left(a + b\right)"),
        ((-a - b) ** 2 * c, "c*(a + b)**2", r"c \, \left(a + b\right)^{2}"),
        (0.5 * (2 * a * b - 2 * c), "a*b - c", r"a \, b - c"),
        # Fractions: one bar.
        (a / b * c / a, "a*c/(b*a)", r"\frac{a \, c}{b \, a}"),
        (2 * (a / 6), "a/3", r"\frac{a}{3}"),
        (-6 * (a / 4), "-3*a/2", r"-\frac{3 \, a}{2}"),
        (0.05 * (a / 2), "0.025*a", r"0.025 \, a"),
        (b / (a / 2), "2*b/a", r"\frac{2 \, b}{a}"),
        (c * (a / b) ** 2, "c*(a/b)**2", r"c \, \left(\frac{a}{b}\right)^{2}"),
        (c * a**-2, "c/a**2", r"\frac{c}{a^{2}}"),
        # Sums: flat, led by a positive summand where there is one.
        (-(-0.25 * a - 0.4 * b), "0.25*a + 0.4*b", r"0.25 \, a + 0.4 \, b"),
        (-(a - 0.05 * ca.cos(c)), "0.05*cos(c) - a", r"0.05 \, \cos{c} - a"),
        (a - (b - (c - 1)), "a - b + c - 1", "a - b + c - 1"),
        (-(a + b), "-a - b", "-a - b"),
        (ca.sin(-(a + b)), "sin(-a - b)", r"\sin{\left(-a - b\right)}"),
        (-(a - 2) - b, "2 - a - b", "2 - a - b"),
        (1 - a + b, "1 - a + b", "1 - a + b"),
        (-a - 2 + b, "b - a - 2", "b - a - 2"),
        ((a + 1) + (b + 2), "a + 3 + b", "a + 3 + b"),
        ((a + 0.1) + (b + 0.2) - 0.3, "a + b", "a + b"),
        ((a * b + c) + b * a, "2*a*b + c", r"2 \, a \, b + c"),
        ((a + b) - (b + c), "a - c", "a - c"),
        (a / 2 + b + a / 2, "a + b", "a + b"),
        ((a - (b - 1)) * 2 - (c - 1), "2*(a - b + 1) - c + 1", r"2 \, \left(a - b + 1\right) - c + 1"),
        (a - ca.if_else(c, b, 0), "a - if_else(c, b, 0)", r"a - \left[c\right] \, b"),
        ((a - b) / ca.if_else(c, -b, 0), "(a - b)/if_else(c, -b, 0)", r"-\frac{a - b}{\left[c\right] \, b}"),
        # Symbols of one name are different ones, and what a float does not hold is left apart.
        (a + ca.SX.sym("a") * ca.SX.sym("a"), "a + a*a", r"a + a \, a"),
        (a * 1e200 * b * 1e200, "1e200*1e200*a*b", r"10^{200} \cdot 10^{200} \, a \, b"),
        (a * np.inf, "inf*a", r"\infty \, a"),
    ],
    ids=lambda value: "",
)
def test_sums_and_products_are_flat(expression, text, latex):
    """Like terms, repeated factors and numbers are collected."""
    assert (to_text(expression), to_latex(expression)) == (text, latex)


@pytest.mark.parametrize(
    ("number", "text", "latex"),
    [
        (0, "0", "0"),
        (3.0, "3", "3"),
        (-1.5, "-1.5", "-1.5"),
        (9.80665, "9.80665", "9.80665"),
        (0.1 + 0.2, "0.3", "0.3"),
        (1 / 3, "0.333333", "0.333333"),
        (123456.789, "123456.789", "123456.789"),
        (100000, "100000", "100000"),
        (2.1e11, "2.1e11", r"2.1 \cdot 10^{11}"),
        (1e-5, "1e-5", "10^{-5}"),
        (-2e-7, "-2e-7", r"-2 \cdot 10^{-7}"),
        (np.inf, "inf", r"\infty"),
        (-np.inf, "-inf", r"-\infty"),
        (np.nan, "nan", r"\mathrm{NaN}"),
    ],
)
def test_numbers(number, text, latex):
    assert (to_text(number), to_latex(number)) == (text, latex)


@pytest.mark.parametrize(
    ("name", "latex"),
    [
        ("crank.x", r"x_{\mathrm{crank}}"),
        ("crank.phi", r"\phi_{\mathrm{crank}}"),
        ("crank.vx", r"\dot{x}_{\mathrm{crank}}"),
        ("crank.vy", r"\dot{y}_{\mathrm{crank}}"),
        ("crank.omega", r"\dot{\phi}_{\mathrm{crank}}"),
        ("crank.ax", r"\ddot{x}_{\mathrm{crank}}"),
        ("crank.alpha", r"\ddot{\phi}_{\mathrm{crank}}"),
        ("left arm_2.x", r"x_{\mathrm{left\ arm\_2}}"),
        ("50% & #1.y", r"y_{\mathrm{50\%\ \&\ \#1}}"),
        ("a{b}^$\\.y", r"y_{\mathrm{a\{b\}\wedge \$\backslash }}"),
        ("pin.lam", r"\lambda_{\mathrm{pin}}"),
        ("pin.lam_1", r"\lambda_{\mathrm{pin}, 1}"),
        ("pin.lam[1]", r"\lambda_{\mathrm{pin}, 1}"),
        ("lam", r"\lambda"),
        ("lam_0", r"\lambda_{0}"),
        ("contact.velocity", r"\dot{\mathrm{contact}}"),
        ("s.acceleration", r"\ddot{s}"),
        ("t", "t"),
        ("tau", r"\tau"),
        ("omega", r"\omega"),
        ("tau_max", r"\tau_{\mathrm{max}}"),
        ("k_1", "k_{1}"),
        ("stiffness", r"\mathrm{stiffness}"),
        ("spring_rate", r"\mathrm{spring\_rate}"),
        ("_", r"\mathrm{\_}"),
        ("crank-pin.x", r"x_{\mathrm{crank\text{-}pin}}"),
    ],
)
def test_names_in_latex(name, latex):
    assert to_latex(ca.SX.sym(name)) == latex


@pytest.mark.parametrize(
    ("expression", "latex"),
    [
        (a - 2 * b, r"a - 2 \, b"),
        (a * (b + c), r"a \, \left(b + c\right)"),
        ((a + b) / (2 * c), r"\frac{a + b}{2 \, c}"),
        (-a / b, r"-\frac{a}{b}"),
        ((a - b) / -c, r"-\frac{a - b}{c}"),
        ((a / b) ** 2, r"\left(\frac{a}{b}\right)^{2}"),
        (1 / a**2, r"\frac{1}{a^{2}}"),
        (ca.cos(a), r"\cos{a}"),
        (ca.cos(a + b), r"\cos{\left(a + b\right)}"),
        (ca.cos(a) ** 2, r"\cos^{2}{a}"),
        (ca.cos(a) ** b, r"\left(\cos{a}\right)^{b}"),
        (ca.cos(a) * b, r"\cos{a} \cdot b"),
        (b * ca.cos(a), r"b \, \cos{a}"),
        (ca.sqrt(a) * ca.fabs(b), r"\sqrt{a} \, \left|b\right|"),
        (ca.log(a), r"\ln{a}"),
        (ca.asin(a), r"\arcsin{a}"),
        (ca.fmax(a, 0), r"\max{\left(a, 0\right)}"),
        (ca.sign(a), r"\operatorname{sgn}{a}"),
        (ca.atan2(a, b), r"\operatorname{atan2}{\left(a, b\right)}"),
        (a ** (-b), "a^{-b}"),
        (ca.if_else(a > 0, b, 0), r"\left[a > 0\right] \, b"),
        (
            ca.if_else(a <= 0, b, -c),
            r"\left[a \leq 0\right] \, b - \left[\lnot \left(a \leq 0\right)\right] \, c",
        ),
        (ca.logic_and(a == b, a != c), r"a = b \land a \neq c"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_latex(expression, latex):
    assert to_latex(expression) == latex


# Round trip: Python reads what was written

FUNCTIONS = {name: getattr(math, name) for name in "sin cos tanh exp sqrt fabs hypot atan atan2".split()}
FUNCTIONS |= {"fmax": max, "fmin": min, "sign": lambda x: float(np.sign(x))}
FUNCTIONS |= {"if_else": lambda condition, x, y: x if condition else y}


def random_expression(random, leaves, depth):
    """Expression with every kind of operation; numbers have few digits, so that the text is exact."""
    leaf = leaves[random.integers(len(leaves))]
    if depth == 0 or random.random() < 0.1:
        return leaf
    x, y = (random_expression(random, leaves, depth - 1) for _ in range(2))
    number = float(random.choice([-2, -1.5, -1, 0.5, 2, 3]))
    return random.choice(
        np.array(
            [
                *(lambda: x + y, lambda: x - y, lambda: x * y, lambda: x / (1 + y**2), lambda: 1 / leaf),
                *(lambda: -x, lambda: 2 * -x, lambda: (y - x) * x**2),
                *(lambda: x + number, lambda: number - x, lambda: number * x, lambda: x / number),
                *(
                    lambda: x**2,
                    lambda: x**3,
                    lambda: -(x**2) * x,
                    lambda: ca.fabs(x) ** 1.5,
                    lambda: x / leaf,
                ),
                *(lambda: (1 + ca.fabs(x)) ** ca.sin(y), lambda: (x - y) - (y - x), lambda: -(x + y) * (-y)),
                *(lambda: ca.sin(x), lambda: ca.cos(x), lambda: ca.atan(x), lambda: ca.tanh(x) ** 4),
                *(lambda: ca.atan2(x, y), lambda: ca.fmax(x, y), lambda: ca.fmin(x, number)),
                *(lambda: ca.hypot(x, y), lambda: x * x / leaf**3),
                *(lambda: ca.sqrt(ca.fabs(x)), lambda: ca.sign(x - y), lambda: ca.exp(-ca.fabs(x))),
                *(lambda: ca.if_else(x > y, x, y), lambda: ca.if_else(x <= number, 0, -y)),
                *(lambda: ca.if_else(ca.logic_or(x < 0, ca.logic_not(y > x)), x, 2),),
                *(lambda: (x > number) * y, lambda: x - (y > x)),
            ]
        )
    )()


@pytest.mark.parametrize("seed", seeds(300))
def test_python_reads_the_text_back(seed):
    random = np.random.default_rng(seed)
    leaves = [X, PHI, a, b]
    expression = random_expression(random, leaves, int(random.integers(1, 5)))
    x, phi, a_value, b_value = values = random.uniform(-2, 2, len(leaves)).tolist()
    expected = float(ca.Function("f", leaves, [expression])(*values))
    text = to_text(expression, limit=10**6)
    names = {**FUNCTIONS, "crank": SimpleNamespace(x=x, phi=phi), "a": a_value, "b": b_value}
    np.testing.assert_allclose(float(eval(text, names)), expected, rtol=1e-9, atol=1e-12, err_msg=text)


def random_chain(random, leaves, depth):
    """Long sums and products of few symbols, nested, with signs and fractions."""
    if depth == 0:
        leaf = leaves[random.integers(len(leaves))]
        return random.choice(np.array([leaf, leaf, leaf**2, ca.cos(leaf), ca.sin(leaf) ** 3, leaf**1.5]))
    whole = random_chain(random, leaves, depth - 1)
    for _ in range(random.integers(1, 6)):
        part = random_chain(random, leaves, random.integers(depth))
        number = float(random.choice([-2, -1.5, -0.4, 0.25, 3, 7]))
        makers = [lambda x, y, n: x + y, lambda x, y, n: x - y, lambda x, y, n: y - x, lambda x, y, n: -x]
        makers += [lambda x, y, n: x * y, lambda x, y, n: y * x, lambda x, y, n: n * x, lambda x, y, n: x + n]
        makers += [lambda x, y, n: n * (x - n * y), lambda x, y, n: -(x - y) * n, lambda x, y, n: x**2]
        makers += [lambda x, y, n: x / y, lambda x, y, n: x / n, lambda x, y, n: y / n + x]
        whole = random.choice(np.array(makers))(whole, part, number)
    return whole


def from_latex(latex):
    """Python for sums, products, fractions and powers in LaTeX."""
    latex = re.sub(r"\\(cos|sin)\^{(\d+)}", r"\1_power{\2}", latex)
    for old, new in [(r"\left(", "("), (r"\right)", ")"), (r" \cdot ", "*"), (r" \, ", "*"), ("^", "**")]:
        latex = latex.replace(old, new)
    return latex.translate(str.maketrans("{}", "()", "\\"))


FROM_LATEX = {
    "frac": lambda above: lambda below: above / below,
    "cos_power": lambda n: lambda x: math.cos(x) ** n,
    "sin_power": lambda n: lambda x: math.sin(x) ** n,
}


@pytest.mark.parametrize("seed", seeds(200))
def test_flat_sums_and_products_keep_the_value(seed, monkeypatch):
    """Text and LaTeX, with numbers in full."""
    monkeypatch.setattr("mbdcasadi.printing.terms.digits", repr)
    monkeypatch.setattr("mbdcasadi.printing.latex.digits", repr)
    random = np.random.default_rng(seed)
    leaves = [a, b, c]
    expression = random_chain(random, leaves, int(random.integers(1, 4)))
    values = random.uniform(0.5, 2, len(leaves)).tolist()
    expected = float(ca.Function("f", leaves, [expression])(*values))
    names = {**FUNCTIONS, **FROM_LATEX, **dict(zip("abc", values, strict=True))}
    for text in (to_text(expression, limit=10**6), from_latex(to_latex(expression, limit=10**6))):
        np.testing.assert_allclose(float(eval(text, names)), expected, rtol=1e-8, atol=1e-9, err_msg=text)


@pytest.mark.parametrize("seed", range(20))
def test_mathtext_reads_the_latex(seed):
    """Matplotlib draws it."""
    random = np.random.default_rng(seed)
    latex = to_latex(random_expression(random, [X, PHI, a, b], 3), limit=10**6)
    # It knows the signs of logic by other names.
    latex = latex.replace(r"\lnot", r"\neg").replace(r"\land", r"\wedge").replace(r"\lor", r"\vee")
    MathTextParser("path").parse(f"${latex}$")


@pytest.mark.parametrize("seed", seeds(30))
def test_braces_and_fences_of_latex_are_closed(seed):
    random = np.random.default_rng(seed)
    latex = to_latex(random_expression(random, [X, PHI, a, b], 4), limit=10**6)
    assert latex.count("{") == latex.count("}") and latex.count(r"\left") == latex.count(r"\right")
    depth = np.cumsum([(char == "{") - (char == "}") for char in latex])
    assert depth.min() >= 0


# Limits and bad input


def test_a_huge_expression_is_counted_and_not_written():
    x = a
    for _ in range(100):
        x = x * x + x
    start = time.perf_counter()
    assert to_text(x) == "… (200 operations)"
    assert to_latex(x) == r"\ldots\;\text{(200 operations)}"
    assert time.perf_counter() - start < 0.5


def test_the_limit_counts_what_is_written():
    expression = a + b + ca.sin(c)
    assert to_text(expression, limit=6) == "a + b + sin(c)"
    assert to_text(expression, limit=5) == "… (3 operations)"


@pytest.mark.slow
def test_a_deep_expression_does_not_exceed_the_stack():
    x = a
    for _ in range(1500):
        x = ca.sin(x)
    assert to_text(x, limit=10**4).count("sin(") == 1500


@pytest.mark.slow
@pytest.mark.parametrize(
    ("extend", "text"),
    [
        (lambda x, k: x + (a if k % 2 else -2 * b), "a + 2500*a - 5000*b"),
        (lambda x, k: c - x, "a"),
        (lambda x, k: x * (a if k % 2 else b), "b**2500*a**2501"),
        (lambda x, k: (x + b) * a if k < 2000 else x, None),
    ],
    ids=["sum", "differences", "product", "Horner"],
)
def test_long_chains_take_neither_stack_nor_time(extend, text):
    x = a
    for k in range(5000):
        x = extend(x, k)
    start = time.perf_counter()
    written = to_text(x, limit=10**5)
    assert written == text or text is None or written == text.replace("a + 2500*a", "2501*a")
    assert to_latex(x, limit=10**5)
    assert time.perf_counter() - start < 10


def test_a_call_of_a_function_falls_back_to_its_name():
    function = ca.Function("tyre", [a, b], [a * b, a + b], {"never_inline": True})
    assert "tyre(a, b)" in to_text(function(a, b)[1])


def test_what_is_no_scalar_expression_is_refused():
    with pytest.raises(ModelError, match=r"to_text: takes a scalar, got shape \(2, 1\); use matrix_to_text"):
        to_text(ca.SX.sym("x", 2))
    with pytest.raises(ModelError, match=r"to_latex: takes an expression in casadi\.SX or a number"):
        to_latex(ca.MX.sym("x"))
    with pytest.raises(ModelError, match=r"matrix_to_latex: takes a matrix in casadi\.SX"):
        matrix_to_latex("M")


# Matrices


def test_matrix_as_text():
    jacobian = ca.jacobian(ca.vertcat(a + ca.cos(c), b - 0.5 * ca.sin(c)), ca.vertcat(a, b, c))
    assert matrix_to_text(jacobian, ["pin x", "y"], ["a", "b", "c"]).splitlines() == [
        "        a  b            c",
        "pin x [ 1  0      -sin(c) ]",
        "y     [ 0  1  -0.5*cos(c) ]",
    ]
    assert matrix_to_text(ca.vertcat(a, b + 1)) == "[     a ]\n[ b + 1 ]"
    assert matrix_to_text(np.eye(2)) == "[ 1  0 ]\n[ 0  1 ]"


def test_matrix_as_latex():
    expected = "\\begin{bmatrix}\na & 0 \\\\\n0 & \\frac{b}{2}\n\\end{bmatrix}"
    assert matrix_to_latex(ca.diag(ca.vertcat(a, b / 2))) == expected


def test_empty_matrices():
    assert matrix_to_text(ca.SX(0, 2)) == ""
    assert matrix_to_text(ca.SX(2, 0)) == "[  ]\n[  ]"


def test_names_must_match_the_shape():
    with pytest.raises(ModelError, match="got 1 row names for 2 rows"):
        matrix_to_text(ca.SX.eye(2), row_names=["x"])
    with pytest.raises(ModelError, match="got 3 column names for 2 columns"):
        matrix_to_text(ca.SX.eye(2), column_names="xyz")
