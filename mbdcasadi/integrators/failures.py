"""Messages of CasADi's integrators on a failure, in plain words."""

from __future__ import annotations

#: What CasADi says of a failure without a reason, and what it then is.
_UNSAID = "Evaluation failed", "the step size became too small, or a value was not finite"
_REASONS = {
    "IDA_TOO_MUCH_WORK": "the integrator took as many steps as it may between two outputs",
    "IDA_ERR_FAIL": "the error test failed again and again at the smallest step",
    "IDA_CONV_FAIL": "Newton's method did not converge at the smallest step",
    "IDA_LSETUP_FAIL": "the linear system of a step is singular",
    "IDA_LSOLVE_FAIL": "the linear system of a step cannot be solved",
    "IDA_LINESEARCH_FAIL": "the search for consistent accelerations did not converge",
    "IDA_FIRST_RES_FAIL": "the equations gave a value that is not finite at the start",
    "IDA_BAD_EWT": "a state grew beyond all bounds",
    "IDA_RES_FAIL": "the equations gave a value that is not finite",
    "IDA_REP_RES_ERR": "the equations gave values that are not finite",
    "IDA_CONSTR_FAIL": "the constraints cannot be met together any more",
    "IDA_NO_RECOVERY": "no consistent accelerations were found",
}


def last_line(error: Exception) -> str:
    """Last line of an error's message."""
    lines = [line for line in str(error).splitlines() if line.strip()]
    return lines[-1] if lines else "no reason given"


def flag_of(error: Exception) -> str:
    """The integrator's flag of a failure, or the last line of its message."""
    text = str(error)
    for word in text.replace('"', " ").split():
        if word.startswith("IDA_"):
            return word
    return last_line(error)


def in_words(flag: str) -> str:
    """Return the meaning of a flag; any other text as it is."""
    return _UNSAID[1] if flag.endswith(_UNSAID[0]) else _REASONS.get(flag, flag)


def reason_of(error: Exception) -> str:
    """Cause for which an integrator stopped, from the error that it raised."""
    return in_words(flag_of(error))
