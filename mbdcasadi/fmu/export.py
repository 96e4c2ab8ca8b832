"""``export_fmu``: a mechanism as a functional mock-up unit."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import casadi as ca
import numpy as np

from ..arguments.inputs import SampledController
from ..arguments.values import position_in
from ..assembly.setup import Setup
from ..errors import FileError, ModelError, warn
from ..integrators.base import RELTOL
from ..integrators.native.build import no_compiler
from ..model.conditions import read_conditions
from ..model.mechanism import Mechanism
from ..model.quantities import listed, refuse_twice
from ..model.symbols import Input, Parameter, number, positive
from ..numerics.console import keyboard_interrupts
from ..numerics.writing import writable
from ..results.state import State
from ..simulation.tolerances import default_abstol
from .archive import binary_of, write_archive
from .description import KINDS, Unit
from .functions import Model
from .sources import source_files
from .variables import variables_of

#: Rate with which drift decays in model exchange, 1/s: drift is small against errors, and nothing becomes stiff.
DRIFT_RATE = 10.0


class Sampled(Protocol):
    """What is sampled and has a unit of its own: a controller."""

    def unit(self, name: str, version: int, units: Mapping[str, str]) -> tuple[Unit, dict[str, str]]:
        """Return its unit and the C files of this, of which the interface of FMI includes the others."""


@keyboard_interrupts("export_fmu")
def export_fmu(
    mechanism: Mechanism | Sampled,
    path: str | Path,
    *,
    inputs: Sequence[Input] | None = None,
    outputs: Mapping[str, Any] | None = None,
    parameters: Sequence[Parameter] | None = None,
    initial: Any = (),
    kind: str | Sequence[str] = "co-simulation",
    version: int = 3,
    units: Mapping[str, str] | None = None,
    t: float = 0.0,
    stop: float | None = None,
    step: float | None = None,
    reltol: float = RELTOL,
    abstol: float | None = None,
    drift_rate: float = DRIFT_RATE,
    binary: bool | None = None,
) -> Path:
    """Write a mechanism as a functional mock-up unit of FMI 2.0 or 3.0.

    The unit needs nothing of this package: it holds the C sources of the
    equations and, for co-simulation, of the solver of :class:`DOP853`, which keeps loops closed
    at position and velocity level; and a binary for this machine if a C compiler is there.
    In model exchange the states are ``(q, v, z)``, and drift from the constraints decays.

    Parameters
    ----------
    mechanism : Mechanism or Controller
        The model; or a :class:`Controller`, which takes `version`, `units` and `binary` alone, for co-simulation. Its
        inputs are the measured states, its outputs the inputs of the machine and the status; a sample is taken at
        the start, and then at the begin of each communication step in which it falls.
    path : str or Path
        File to write, ``engine.fmu``.
    inputs : sequence of Input, optional
        Inputs of the unit; all of the mechanism by default. Others keep their own value.
    outputs : mapping of str to expression, optional
        Outputs by name: any scalar expression, also of accelerations, reactions and energies.
    parameters : sequence of Parameter, optional
        Parameters that can be changed, also during a simulation; all of the mechanism by default.
    initial : sequence of relations, or State
        Conditions at the start (see :func:`assemble`), which may hold parameters, or a state. If
        parameters or the start time are changed, the unit is assembled again under these conditions.
    kind : {"co-simulation", "model-exchange"} or both of them
        Kind of simulation.
    version : {2, 3}
        FMI 2.0 or 3.0.
    units : mapping of str to str, optional
        Units of inputs, parameters and outputs by name, as ``{"pin force": "N"}``.
    t : float, default 0
        Time of the start, s.
    stop, step : float, optional
        End and communication step of the default experiment, s.
    reltol, abstol : float, default 1e-8
        Tolerances in co-simulation, if the importer gives none; the absolute one follows the relative one. It is a
        millionth of the size of a mechanism that is smaller than 1 cm.
    drift_rate : float, default 10
        Rate with which drift from the constraints decays in model exchange, 1/s.
    binary : bool, optional
        True for a unit that must hold a binary, False for one with sources only.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    ModelError
        For exact stick and slip, controllers in Python, unknown inputs, parameters and symbols, names
        that are used twice; with ``binary=True`` also if no compiler is there.
    FileError
        If the file cannot be written; nothing is left of it.
    MechanismError
        If the mechanism cannot be assembled at the start.

    Warns
    -----
    MechanismWarning
        If no C compiler is there, so that the unit holds sources only.

    References
    ----------
    Modelica Association, *Functional Mock-up Interface Specification*, 2.0.4 (2022) and 3.0.1 (2023).

    Examples
    --------
    >>> import tempfile
    >>> import mbdcasadi as mbd
    >>> arm = mbd.Body("arm", mass=1, inertia=1 / 12, pose=(0.5, 0, 0))
    >>> hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    >>> pendulum = mbd.Mechanism(bodies=[arm], joints=[hinge], forces=[mbd.Gravity()], name="pendulum")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     mbd.export_fmu(pendulum, f"{folder}/pendulum.fmu", outputs={"angle": hinge.angle}, binary=False).name
    'pendulum.fmu'
    """
    target = _target(path)
    kinds = _kinds(kind)
    _refuse_settings(version, binary)
    if isinstance(mechanism, SampledController) and hasattr(mechanism, "unit"):
        settings = {"inputs=": inputs, "outputs=": outputs, "parameters=": parameters, "stop=": stop, "step=": step}
        others = [name for name, value in settings.items() if value is not None]
        if others or initial != () or kinds != {"co-simulation"}:
            what = others[0] if others else "kind='model-exchange'" if kinds != {"co-simulation"} else "initial="
            raise ModelError(f"export_fmu: of a controller, {what} has no meaning; it takes version=, units=, binary=")
        own, sources = mechanism.unit(target.stem, version, _units(units))
        _write(path, own, sources, binary)
        return Path(path)
    if not isinstance(mechanism, Mechanism):
        raise ModelError(f"export_fmu: takes a Mechanism or a Controller, got {mechanism!r}")
    shown_inputs = _listed(inputs, mechanism.inputs, Input, "inputs=")
    shown_parameters = _listed(parameters, mechanism.parameters, Parameter, "parameters=")
    stop, step = _experiment(number(t, "export_fmu", "t"), stop, step)
    reltol, drift = (positive(x, "export_fmu", name) for name, x in (("reltol", reltol), ("drift_rate", drift_rate)))
    given = None if abstol is None else positive(abstol, "export_fmu", "abstol")
    setup = Setup(mechanism, "export_fmu", t=t, initial=initial)
    abstol = default_abstol(setup.numeric) if given is None else given
    model = _model(setup, initial, outputs, drift)
    variables = variables_of(model, shown_inputs, shown_parameters, _units(units))
    unit = Unit(model, variables, mechanism.name or target.stem, version, kinds, reltol, abstol, stop, step)
    _write(path, unit, source_files(unit), binary)
    return Path(path)


def _write(path: Any, unit: Unit, sources: Mapping[str, str], binary: bool | None) -> None:
    content, files = _content(unit, sources)
    binaries = {} if binary is False else _binaries(unit, files, path, required=bool(binary))
    write_archive(Path(path), content | binaries)


def _refuse_settings(version: Any, binary: Any) -> None:
    if type(version) is not int or version not in (2, 3):
        raise ModelError(f"export_fmu: version= is 2 or 3 (FMI 2.0 and 3.0), got {version!r}")
    if binary not in (None, True, False):
        raise ModelError(f"export_fmu: binary= is True, False or None, got {binary!r}")


def _content(unit: Unit, files: Mapping[str, str]) -> tuple[dict[str, bytes], dict[str, str]]:
    """Files of the archive but for the binary, and the C files with the token, which is a digest of all of them."""
    draft = unit.model_description("")
    digest = hashlib.sha256(b"\0".join([draft, *(text.encode() for text in files.values())])).hexdigest()
    token = f"{{{digest[:8]}-{digest[8:12]}-{digest[12:16]}-{digest[16:20]}-{digest[20:32]}}}"
    signed = {**files, "model.h": files["model.h"] + f'#define MODEL_TOKEN "{token}"\n'}
    content = {"modelDescription.xml": unit.model_description(token)}
    content |= {f"sources/{name}": text.encode() for name, text in signed.items()}
    if unit.version == 3:
        content["sources/buildDescription.xml"] = unit.build_description()
    return content, signed


def _binaries(unit: Unit, files: Mapping[str, str], path: Any, *, required: bool) -> dict[str, bytes]:
    binaries = binary_of(unit, files)
    if binaries is None:
        reason = f"{no_compiler()}, or FMI names no folder for this machine"
        if required:
            raise ModelError(
                f"export_fmu: {reason}, and binary=True asks for a binary; binary=False writes sources only"
            )
        warn(f"export_fmu: {reason}: {Path(path).name} holds sources and no binary; importers that compile take it")
    return binaries or {}


def _target(path: Any) -> Path:
    target = writable(path)
    if target.suffix.lower() != ".fmu":
        raise FileError(f"{path}: the name of a functional mock-up unit ends in .fmu")
    return target


def _kinds(kind: Any) -> frozenset[str]:
    names = (kind,) if isinstance(kind, str) else tuple(kind) if isinstance(kind, Iterable) else (kind,)
    kinds = KINDS if names == ("both",) else names
    if not kinds or any(entry not in KINDS for entry in kinds):
        raise ModelError(f"export_fmu: kind= is 'co-simulation', 'model-exchange' or both, got {kind!r}")
    return frozenset(kinds)


def _experiment(t: float, stop: float | None, step: float | None) -> tuple[float | None, float | None]:
    """End and communication step of the default experiment."""
    if stop is not None and (stop := number(stop, "export_fmu", "stop")) <= t:
        raise ModelError(f"export_fmu: stop= must be later than the start at t = {t:g} s, got {stop:g}")
    return stop, None if step is None else positive(step, "export_fmu", "step")


def _units(units: Any) -> dict[str, str]:
    if units is None:
        return {}
    if not isinstance(units, Mapping) or not all(isinstance(text, str) for pair in units.items() for text in pair):
        raise ModelError(f"export_fmu: units= takes a dict of names and units as {{'pin force': 'N'}}, got {units!r}")
    return dict(units)


def _listed(chosen: Any, known: Sequence[Any], wanted: type, argument: str) -> tuple[Any, ...]:
    if chosen is None:
        return tuple(known)
    what = f"export_fmu: {argument}"
    values: Iterable[Any] = chosen if isinstance(chosen, list | tuple) else [chosen]
    values = chosen.values() if isinstance(chosen, Mapping) else values
    if any(isinstance(value, SampledController) for value in values):
        raise ModelError(
            f"{what} holds a SampledController, which runs in Python; export the input, and connect the controller to "
            "it outside"
        )
    symbols = listed(chosen, wanted, what)
    for symbol in symbols:
        position_in(known, symbol, what)
    refuse_twice(symbols, what)
    return symbols


def _model(setup: Setup, initial: Any, outputs: Any, drift_rate: float) -> Model:
    numeric = setup.numeric
    start = setup.start
    if start.obstacle is not None:
        raise start.obstacle
    conditions = () if isinstance(initial, State) else read_conditions(initial)
    model = Model(
        numeric, setup.signals, start, conditions, _outputs(setup, outputs), drift_rate, isinstance(initial, State)
    )
    model.refuse_unsupported()
    _refuse_undefined(model)
    return model


def _outputs(setup: Setup, outputs: Any) -> dict[str, ca.SX]:
    if outputs is not None and not isinstance(outputs, Mapping):
        raise ModelError(f"export_fmu: outputs= takes {{name: expression}}, got {outputs!r}")
    expressions = {}
    for name, value in (outputs or {}).items():
        if not isinstance(name, str):
            raise ModelError(f"export_fmu: outputs= takes names as strings, got {name!r}")
        try:
            expression = ca.SX(value)
        except (NotImplementedError, TypeError):
            raise ModelError(f"export_fmu: the output '{name}' is not an expression, got {value!r}") from None
        if expression.numel() != 1:
            raise ModelError(f"export_fmu: the output '{name}' must be a scalar, got shape {expression.shape}")
        setup.eom.function(expression)  # refuses symbols that the mechanism does not have
        expressions[name] = ca.densify(expression)
    return expressions


def _refuse_undefined(model: Model) -> None:
    """Raise for outputs that have no value at the start."""
    for name, expression in model.outputs.items():
        if not np.isfinite(float(model.start[expression])):
            raise ModelError(
                f"export_fmu: the output '{name}' is not finite at t = {model.start.t:.6g} s: data evaluated outside "
                "their range, a division by zero, or a root of a negative number"
            )
