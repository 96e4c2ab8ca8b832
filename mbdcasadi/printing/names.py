"""Names of symbols in LaTeX."""

from __future__ import annotations

import re

_GREEK = (
    "alpha beta gamma delta epsilon zeta eta theta iota kappa lambda mu nu xi pi rho sigma tau upsilon phi "
    "chi psi omega Gamma Delta Theta Lambda Xi Pi Sigma Upsilon Phi Psi Omega"
).split()
_LETTERS = {**{name: rf"\{name}" for name in _GREEK}, "lam": r"\lambda"}
_COORDINATES = {
    **{"x": "x", "y": "y", "phi": r"\phi", "vx": r"\dot{x}", "vy": r"\dot{y}", "omega": r"\dot{\phi}"},
    **{"ax": r"\ddot{x}", "ay": r"\ddot{y}", "alpha": r"\ddot{\phi}"},
}
_RATES = {"velocity": r"\dot", "acceleration": r"\ddot"}
_SPECIAL = {
    **{c: rf"\{c}" for c in "_ %&#${}"},
    **{"\\": r"\backslash ", "^": r"\wedge ", "~": r"\sim ", "-": r"\text{-}"},
}


def escaped(text: str) -> str:
    """Text of a name, with what LaTeX would read as a command masked."""
    return "".join(_SPECIAL.get(c, c) for c in text)


def _roman(text: str) -> str:
    return rf"\mathrm{{{escaped(text)}}}"


def _latex_word(name: str) -> tuple[str, str]:
    """Letter and index of a name without an owner: ``tau_1`` is a tau with index 1."""
    letter, _, index = name.partition("_")
    if letter in _LETTERS or len(letter) == 1:
        letter = _LETTERS.get(letter, letter if letter.isalnum() else escaped(letter))
        if not index and not name.endswith("_"):
            return letter, ""
        if index.isalnum():
            return letter, index if index.isdigit() or len(index) == 1 else _roman(index)
    return _roman(name), ""


def latex_name(name: str) -> str:
    """Symbol in LaTeX: a coordinate or multiplier carries its owner as index."""
    owner, _, level = name.rpartition(".")
    index = [_roman(owner)] if owner else []
    count = re.fullmatch(r"lam(?:_(\d+)|\[(\d+)\])", level)
    if owner and level in _RATES:
        letter, below = _latex_word(owner)
        letter, index = f"{_RATES[level]}{{{letter}}}", [below] if below else []
    elif owner and level in _COORDINATES:
        letter = _COORDINATES[level]
    elif owner and count:
        letter = r"\lambda"
        index.append(count[1] or count[2])
    else:
        letter, below = _latex_word(level)
        index += [below] if below else []
    return f"{letter}_{{{', '.join(index)}}}" if index else letter
