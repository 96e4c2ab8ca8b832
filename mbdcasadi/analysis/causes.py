"""Why an integrator stopped, in the words of the model."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..equations.numeric import NumericEquations

_FLAGS = {
    "IDA_TOO_MUCH_WORK": "the integrator took as many steps as it may between two outputs",
    "IDA_ERR_FAIL": "the error test failed again and again at the smallest step",
    "IDA_CONV_FAIL": "Newton's method did not converge at the smallest step",
    "IDA_LSETUP_FAIL": "the linear system of a step is singular",
    "IDA_RES_FAIL": "the equations gave a value that is not finite",
    "IDA_REP_RES_ERR": "the equations gave values that are not finite",
    "IDA_NO_RECOVERY": "no consistent accelerations were found",
}


def cause_of_failure(
    numeric: NumericEquations, t: float, q: np.ndarray, v: np.ndarray, z: np.ndarray, flag: str
) -> str:
    """Likely cause of a failure after the state that was reached last.

    Parameters
    ----------
    numeric : NumericEquations
        Equations at the parameters of the run.
    t : float
        Time of the last state.
    q, v, z : numpy.ndarray
        The last state, each (1, k).
    flag : str
        The integrator's own word.
    """
    eom = numeric.eom
    said = _FLAGS.get(flag, flag)
    rank = numeric.rank(t, q[0])
    values = rank.singular_values
    if values.size and values[-1] < 1e-3 * values[0]:
        weight = np.abs(np.linalg.svd(_scaled_rows(numeric, t, q[0]))[0][:, -1])
        rows = [eom.row_names[k] for k in np.argsort(-weight) if weight[k] > 0.1]
        return f"the pose is near a singular one, in which the rows {', '.join(rows)} depend on each other ({said})"
    force = ca.Function("Q", [eom.t, eom.q, eom.v, eom.z, eom.u, eom.p, eom.lam], [eom.Q])
    loads = force(t, q[0], v[0], z[0], eom.input_values, numeric.p, np.zeros(eom.lam.numel())).full().ravel()
    if not np.all(np.isfinite(loads)):
        names = [eom.coordinate_names[k] for k in np.flatnonzero(~np.isfinite(loads))]
        return f"an applied force is not finite; it acts on {', '.join(names)} ({said})"
    fastest = int(np.argmax(np.abs(v[0])))
    return (
        f"{said}; a force may jump there, or grow without bound (fastest coordinate: {eom.coordinate_names[fastest]} "
        f"at {v[0][fastest]:.3g} per second); method='rosenbrock', or events at the jumps, may help"
    )


def _scaled_rows(numeric: NumericEquations, t: float, q: np.ndarray) -> np.ndarray:
    jacobian = numeric.velocity(t, q)[0] * numeric.column_scale
    size = np.linalg.norm(jacobian, axis=1, keepdims=True)
    return jacobian / np.where(size > 1e-12, size, 1.0)
