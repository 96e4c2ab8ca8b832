"""The base class of integrators: a method with its tolerances."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

from ..errors import SimulationError
from ..model.immutable import Immutable
from ..model.quantities import yes_or_no
from ..model.symbols import number
from .native import build

if TYPE_CHECKING:
    from .native.runner import Runner

#: Tolerances unless others are given.
RELTOL, ABSTOL = 1e-8, 1e-8
#: Tightest tolerance that a method is given by itself.
TIGHTEST = 1e-12
#: Options of CasADi's integrators that are lengths of steps, beside the longest one.
STEP_LENGTHS = ("min_step_size", "step0", "step_size")


class Integrator(Immutable):
    """A method of integration with its tolerances; base class of all of them.

    A further method is a subclass in a file of its own, listed in
    ``mbdcasadi.integrators.INTEGRATORS``; ``method=`` of :func:`simulate` and of
    every other analysis takes it by its name or as an object, which carries its
    tolerances.

    Parameters
    ----------
    reltol, abstol : float, default 1e-8
        Relative and absolute tolerance of the local error.
    max_step : float, optional
        Longest step, s; otherwise the error alone decides, and the time-dependence of the model.
    jit : bool, default False
        Compile the equations with the C compiler of the machine.
    options : mapping, optional
        Passed on to CasADi's integrator, but for ``max_step_size``, which is `max_step`, s.

    Attributes
    ----------
    name : str
        Name for ``method=``.
    plugin : str
        Name of the integrator in CasADi; empty for a method that is none of these.
    solves_algebraic : bool
        True if it takes algebraic unknowns, as bodies without mass and forces that depend on reactions need.
    is_multistep : bool
        True if a start costs many small steps.
    stops_by_input : bool
        True if it stops where an input changes, so that stops need not be known when it is compiled; False for
        plugins of CasADi that take the outputs at which to stop as an option, ``control_group_size``.
    quadratures_in_error_test : bool
        True if integrals that are carried along take part in the error test.
    variations_in_error_test : bool
        True if derivatives of the motion take part in the error test.
    whole_run : type of Runner or None
        Class that runs it in C over a whole run, looks inside its steps and returns states on the constraints; None for
        methods that go from output to output.
    error_at_switches : float
        Error of steps across what switches in the state, as the touch of a contact, over its estimate: tolerances are
        tightened by it for equations that do.
    stable_decay : float
        Product of step and rate up to which what decays at a rate is stable; infinite for implicit methods.

    Raises
    ------
    SimulationError
        For tolerances and steps that are not positive, options that are lengths of steps, and without a compiler
        for ``jit``.
    """

    name: ClassVar[str]
    plugin: ClassVar[str] = ""
    solves_algebraic: ClassVar[bool] = True
    is_multistep: ClassVar[bool] = False
    stops_by_input: ClassVar[bool] = True
    quadratures_in_error_test: ClassVar[bool] = True
    variations_in_error_test: ClassVar[bool] = False
    whole_run: ClassVar[type[Runner] | None] = None
    error_at_switches: ClassVar[float] = 1.0
    stable_decay: ClassVar[float] = float("inf")

    def __init__(
        self,
        reltol: float = RELTOL,
        abstol: float = ABSTOL,
        *,
        max_step: float | None = None,
        jit: bool = False,
        options: Mapping[str, Any] | None = None,
    ):
        self.reltol = self._positive(reltol, "reltol")
        self.abstol = self._positive(abstol, "abstol")
        self.jit = yes_or_no(jit, type(self).__name__, "jit")
        if options is not None and not isinstance(options, Mapping):
            raise SimulationError(f"{type(self).__name__}: options= takes a dict for the integrator, got {options!r}")
        others = dict(options or {})
        max_step = others.pop("max_step_size", max_step)
        self.max_step = None if max_step is None else self._positive(max_step, "max_step")
        self.options: Mapping[str, Any] = MappingProxyType(others)
        if self.options and not self.plugin:
            raise SimulationError(f"{type(self).__name__} takes no options, got {', '.join(map(repr, self.options))}")
        self._refuse_lengths_of_steps()
        if self.jit:
            required_compiler()

    def _refuse_lengths_of_steps(self) -> None:
        """Raise for options that would not be in seconds: CasADi's integrator runs over pieces of length 1."""
        given = [name for name in STEP_LENGTHS if name in self.options]
        if given:
            raise SimulationError(
                f"{type(self).__name__}: option {given[0]!r} would not be in seconds, as a run is integrated piece by "
                "piece; max_step= takes the longest step, s, and the tolerances decide on the others"
            )

    def _positive(self, value: Any, quantity: str) -> float:
        result = number(value, type(self).__name__, quantity)
        if result <= 0:
            raise SimulationError(f"{type(self).__name__}: {quantity} must be positive, got {result}")
        return result

    @property
    def tolerances(self) -> tuple[float, float]:
        """Relative and absolute tolerance."""
        return self.reltol, self.abstol

    def longest_step(self, *limits: float | None) -> float:
        """Longest step under further limits, each None if there is none, s; infinite without any limit."""
        return min((limit for limit in (self.max_step, *limits) if limit is not None), default=math.inf)

    def replace(self, **changes: Any) -> Integrator:
        """Return the same method with some arguments replaced."""
        return type(self)(**(self._arguments | changes))

    def for_switches(self) -> Integrator:
        """Return the method with the tolerances for equations that switch in the state."""
        reltol, abstol = (tightened(tolerance, self.error_at_switches, TIGHTEST) for tolerance in self.tolerances)
        return self.replace(reltol=reltol, abstol=abstol)

    @property
    def _arguments(self) -> dict[str, Any]:
        names = ("reltol", "abstol", "max_step", "jit")
        return {name: getattr(self, name) for name in names} | {"options": dict(self.options)}

    def __reduce__(self) -> tuple[Any, ...]:
        return partial(type(self), **self._arguments), ()

    @property
    def key(self) -> tuple[Any, ...]:
        """Everything that decides on the compiled integrator, to keep it by."""
        options = tuple(sorted((name, repr(value)) for name, value in self.options.items()))
        return self.name, self.reltol, self.abstol, self.jit, options

    def plugin_options(self, *, algebraic: bool) -> dict[str, Any]:
        """Options of CasADi's integrator, with those of the user on top.

        Parameters
        ----------
        algebraic : bool
            True if there are algebraic unknowns.

        Raises
        ------
        SimulationError
            For a method that is no integrator of CasADi.
        """
        if not self.plugin:
            raise SimulationError(
                f'method="{self.name}" runs in code of its own and is no CasADi function, as sweeps and derivatives '
                'need it; take method="idas"'
            )
        settings = {"reltol": self.reltol, "abstol": self.abstol, "show_eval_warnings": False, "error_on_fail": False}
        return settings | self._compiler_options | dict(self.options)

    @property
    def _compiler_options(self) -> dict[str, Any]:
        if not self.jit:
            return {}
        flags = {"compiler": " ".join(required_compiler().command), "flags": ["-O2"], "verbose": False}
        return {"jit": True, "compiler": "shell", "jit_options": flags}

    def over_pieces(self, forms: Any) -> Any:
        """Return what integrates over pieces of a run in the place of an integrator of CasADi; None for such a one.

        Parameters
        ----------
        forms : Forms
            The equations.
        """
        return None

    def __repr__(self) -> str:
        parts = [f"reltol={self.reltol:g}", f"abstol={self.abstol:g}"]
        parts += [f"max_step={self.max_step:g}"] if self.max_step is not None else []
        parts += ["jit=True"] if self.jit else []
        parts += [f"options={dict(self.options)}"] if self.options else []
        return f"{type(self).__name__}({', '.join(parts)})"


def tightened(tolerance: float, factor: float, tightest: float) -> float:
    """Local tolerance of a multistep method, whose global error is well above it."""
    return max(tolerance / factor, min(tolerance, tightest))


def required_compiler() -> build.Compiler:
    """Return the C compiler that ``jit`` needs, or raise if there is none."""
    using = build.compiler()
    if using is None:
        raise SimulationError(
            "jit=True needs a C compiler, and none is on the path (of gcc, clang, cc, or the one that $CC names); "
            "install one or leave jit out"
        )
    return using
