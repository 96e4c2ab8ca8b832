"""The cases of a sweep as numbers for one compiled run."""

from __future__ import annotations

import warnings
from typing import Any

import casadi as ca
import numpy as np

from ..arguments.values import position_in
from ..assembly.setup import Setup
from ..errors import AssemblyError, MechanismError, MechanismWarning, ModelError, SingularityError, warn
from ..model.conditions import read_conditions
from ..model.mechanism import Mechanism
from ..model.symbols import Parameter
from ..results.state import State
from ..sensitivity.compiled_run import MotionSetup
from .starts import repeat_for_case
from .sweep_file import fingerprint
from .whole_runs import SweepSetup

#: Ratio of the masses of cases up to which one scaling serves all: with 1e6 no error was seen, with 1e12 it was.
LIKE_MASSES = 1e8
#: Cases that are tried as the one from which the others are reached.
TRIES = 100


class Plan:
    """The cases of a sweep, as arguments of compiled runs.

    Parameters
    ----------
    fixed : list of (Parameter, float)
        Values of parameters that do not vary.
    varied : dict
        Parameter or input to its values (k,).
    given : dict
        Further arguments of :class:`SweepSetup`.

    Attributes
    ----------
    setup : Setup
        The arguments, read; nothing is assembled.
    p, levels : numpy.ndarray
        Parameters (k, n_p), and values of the inputs that are numbers (k, n_levels).
    """

    def __init__(
        self,
        mechanism: Mechanism,
        times: Any,
        fixed: list[tuple[Any, Any]],
        varied: dict[Any, np.ndarray],
        given: dict[str, Any],
    ):
        self._mechanism, self._times, self._fixed, self._varied, self._given = mechanism, times, fixed, varied, given
        self.count = len(next(iter(varied.values())))
        shared = {name: given[name] for name in ("initial", "inputs")}
        with warnings.catch_warnings():
            # limits of what varies are looked at in all cases
            warnings.simplefilter("ignore", MechanismWarning)
            self.setup = Setup(
                mechanism, "sweep", times=times, parameters=self._parameters(0), takes_duration=False, **shared
            )
        self.p, self.levels = self._values()
        self._report_exceeded_limits()
        self._report_unlike_masses()

    def _parameters(self, case: int) -> list[tuple[Any, Any]]:
        varied = [(key, column[case]) for key, column in self._varied.items() if isinstance(key, Parameter)]
        return [*self._fixed, *varied]

    def _values(self) -> tuple[np.ndarray, np.ndarray]:
        mechanism, signals = self._mechanism, self.setup.signals
        p, levels = np.tile(self.setup.p, (self.count, 1)), np.tile(signals.level_values, (self.count, 1))
        for key, values in self._varied.items():
            if isinstance(key, Parameter):
                p[:, position_in(mechanism.parameters, key, "cases=")] = values
                continue
            k = position_in(mechanism.inputs, key, "cases=")
            if k not in signals.level_places:
                raise ModelError(f"sweep: input '{key.label}' is in cases= and, varying, in inputs= too; leave one out")
            levels[:, signals.level_places[k]] = values
        return p, levels

    def _report_exceeded_limits(self) -> None:
        for parameter, values in zip(self._mechanism.parameters, self.p.T, strict=True):
            beyond = np.flatnonzero((values < parameter.lower) | (values > parameter.upper))
            if beyond.size:
                shown = ", ".join(str(k) for k in beyond[:5]) + (" …" if beyond.size > 5 else "")
                warn(
                    f"sweep: parameter '{parameter.label}' is beyond its limits {parameter.lower:.6g} … "
                    f"{parameter.upper:.6g} in {beyond.size} of {self.count} cases ({shown}); they are used as given"
                )

    def _report_unlike_masses(self) -> None:
        eom = self.setup.eom
        if not ca.depends_on(eom.own_masses, eom.p):
            return
        masses = ca.Function("masses", [eom.p], [ca.densify(eom.own_masses)])(ca.DM(self.p.T)).full().T
        with np.errstate(divide="ignore", invalid="ignore"):
            ratios = masses / masses[0]
        ratios = ratios[np.isfinite(ratios) & (ratios > 0)]
        if ratios.size and ratios.max() > LIKE_MASSES * ratios.min():
            warn(
                f"sweep: masses or inertias of the cases differ by a factor of {ratios.max() / ratios.min():.1g}, and "
                "the equations are scaled for one of them: errors may be larger than the tolerances ask for; sweep "
                "cases of like masses separately"
            )

    def fingerprint(self, named: list[tuple[Any, ca.SX]]) -> str:
        """Digest of the equations, the outputs, the start, the inputs, the settings and all numbers."""
        setup, eom, signals = self.setup, self.setup.eom, self.setup.signals
        expressions = [eom.mass_diagonal, eom.Q, eom.Phi, eom.Phi_q, eom.z_rate, signals.parametrised]
        expressions += [ca.vec(e) for _, e in named]
        initial, numbers = setup.initial, [*eom.estimate]
        if isinstance(initial, State):
            numbers += [initial.q, initial.v, initial.z]
        else:
            conditions = read_conditions(initial)
            expressions += [c.expression for c in conditions]
            numbers.append(np.array([c.equality for c in conditions], float))
        # a serialised function holds every constant to the last digit; printed expressions do not
        known = [*eom.symbols, signals.levels, signals.channel]
        content = ca.Function("sweep", known, [ca.densify(e) for e in expressions]).serialize()
        samples = [np.asarray(v) for v in signals.samples.values()]
        names = [name for name, _ in named if isinstance(name, str)]
        settings = repr([self._given[name] for name in ("method", "reltol", "abstol")])
        return fingerprint(content, *names, settings, setup.grid, *samples, *numbers, self.p, self.levels)

    def first_assembled(self) -> MotionSetup:
        """The mechanism at the first of the cases, spread over all of them, that can be assembled.

        Raises
        ------
        MechanismError
            Reason for which the first one cannot, if none can.
        """
        obstacle: MechanismError | None = None
        varies = any(isinstance(key, Parameter) for key in self._varied)
        for k in np.unique(np.linspace(0, self.count - 1, min(self.count, TRIES)).astype(int)):
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                try:
                    arguments = self._given | {"parameters": self._parameters(int(k))}
                    setup = SweepSetup(self._mechanism, "sweep", self._times, **arguments)
                except (AssemblyError, SingularityError) as error:
                    obstacle = obstacle or error
                    continue
                except ModelError as error:
                    # a length below zero belongs to its case; all else is wrong in every case
                    if not varies:
                        raise
                    obstacle = obstacle or error
                    continue
            repeat_for_case([w for w in caught if "the limits that it carries" not in str(w.message)], int(k))
            return setup
        assert obstacle is not None
        raise obstacle
