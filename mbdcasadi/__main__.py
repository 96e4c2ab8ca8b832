"""The command line: ``python -m mbdcasadi run MODEL.adm ANALYSIS.acf``, ``check MODEL.adm`` and ``export-fmu``."""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import mbdcasadi as mbd

from .files import MODEL_READERS, read_model
from .files.acf import Analysis
from .integrators import INTEGRATORS
from .numerics.console import interruptible
from .numerics.writing import whole_file, writable
from .results.columns import default_expressions
from .results.summary import summary

#: Exit status of a wrong model or a run that stops, and of Ctrl-C.
WRONG, STOPPED = 2, 130
#: Units of the outputs of an exported model, by the ends of their names.
UNITS = {"ax": "m/s2", "ay": "m/s2", "alpha": "rad/s2", "fx": "N", "fy": "N", "torque": "N.m"}
#: Part of messages that is of use in Python alone.
PARTIAL = "; what was computed is in .partial"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status: 0, 2 after an error, 130 after Ctrl-C."""
    options = _parser().parse_args(arguments)
    with interruptible() as interruption:
        try:
            options.command(options)
        except mbd.Interrupted as error:
            return _interrupted(error, options)
        except (KeyboardInterrupt, Exception) as error:
            # in CasADi's conversions Ctrl-C comes back as an error of another kind
            if interruption.requested or isinstance(error, KeyboardInterrupt):
                return _failed(KeyboardInterrupt(), options, STOPPED)
            if isinstance(error, (mbd.MechanismError, OSError)):
                return _failed(error, options, WRONG)
            raise
    return 0


def _parser() -> argparse.ArgumentParser:
    methods, models = ", ".join(method.name for method in INTEGRATORS), ", ".join(MODEL_READERS)
    parser = argparse.ArgumentParser(
        prog="mbdcasadi",
        description="Planar mechanisms from model files.",
        epilog=f"Models: {models}. Analyses: .acf. Methods of integration: {methods}, auto.",
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {mbd.__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    run = commands.add_parser("run", help="run an analysis of a model", description="Run an analysis of a model.")
    run.add_argument("model", metavar="MODEL", type=Path, help=f"the mechanism: {models}")
    run.add_argument("analysis", metavar="ANALYSIS.acf", type=Path, help="the analysis")
    run.add_argument("--csv", metavar="FILE", type=Path, help="write motion, reactions and efforts as a table (.csv)")
    run.add_argument("--plot", metavar="FILE", type=Path, help="draw them over time (.png, .pdf, .svg, .jpg, …)")
    run.add_argument("--animate", metavar="FILE", type=Path, help="show the motion (.html, .gif, .mp4)")
    run.add_argument("--save", metavar="FILE", type=Path, help="write the trajectory for mbd.read_trajectory (.npz)")
    run.add_argument("--method", metavar="NAME", help=f"integrator for dynamics: {methods}, auto (default idas)")
    run.add_argument("--tolerance", metavar="X", type=float, help="its relative and absolute tolerance (default 1e-8)")
    run.add_argument("--quiet", action="store_true", help="print neither progress nor summary")
    run.set_defaults(command=_run)
    check = commands.add_parser("check", help="check a model", description="Check a model: freedom, redundancy, names.")
    check.add_argument("model", metavar="MODEL", type=Path, help=f"the mechanism: {models}")
    check.set_defaults(command=_check)
    unit = commands.add_parser(
        "export-fmu",
        help="write a model as a functional mock-up unit",
        description="Write a model as a functional mock-up unit, with the motion and all loads as outputs.",
    )
    unit.add_argument("model", metavar="MODEL", type=Path, help=f"the mechanism: {models}")
    unit.add_argument("analysis", metavar="ANALYSIS.acf", type=Path, help="end and step of the default experiment")
    unit.add_argument("unit", metavar="OUT.fmu", type=Path, help="the file to write")
    unit.add_argument("--version", metavar="N", type=int, default=3, help="FMI version, 2 or 3 (default 3)")
    unit.add_argument(
        "--kind", metavar="KIND", default="both", help="co-simulation, model-exchange or both (default both)"
    )
    unit.add_argument("--sources-only", action="store_true", help="write no binary for this machine")
    unit.set_defaults(command=_export_unit)
    return parser


def _failed(error: BaseException, options: argparse.Namespace, status: int) -> int:
    """Report in one sentence what went wrong, and that no file was written if some were requested."""
    reason = " ".join(str(error).split()) or "stopped by the user"
    if isinstance(error, OSError) and not isinstance(error, mbd.MechanismError):
        reason = f"{error.filename}: {error.strerror}" if error.filename else reason
    reason = reason.replace(PARTIAL, "")
    wanted = [str(path) for path in _outputs(options).values()]
    if getattr(error, "partial", None) is not None and wanted:
        reason += f"; {', '.join(wanted)} {'was' if len(wanted) == 1 else 'were'} not written"
    print(f"mbdcasadi: {reason}", file=sys.stderr)
    return status


def _interrupted(error: mbd.Interrupted, options: argparse.Namespace) -> int:
    """Write the outputs of the motion that had been computed when the user stopped the run, and report it."""
    motion, said = error.partial, [" ".join(str(error).split()).replace(PARTIAL, "")]
    for kind, path in _outputs(options).items() if motion is not None and len(motion) else ():
        try:
            _write(motion, {kind: path})
            said.append(f"{path} holds the motion up to t = {motion.t[-1]:.6g} s")
        except (mbd.MechanismError, OSError) as failure:
            said.append(f"{path} was not written ({failure})")
    print(f"mbdcasadi: {'; '.join(said)}", file=sys.stderr)
    return STOPPED


# --- run -----------------------------------------------------------------------------
def _outputs(options: argparse.Namespace) -> dict[str, Path]:
    kinds = ("csv", "plot", "animate", "save")
    return {kind: path for kind in kinds if (path := getattr(options, kind, None)) is not None}


def _run(options: argparse.Namespace) -> None:
    _check_outputs(_outputs(options), (options.model, options.analysis))
    with _notes() as notes:
        mechanism = read_model(options.model)
        analysis = mbd.read_acf(options.analysis)
        motion = _analyse(mechanism, analysis, options)
        _write(motion, _outputs(options))
        freedom = None if options.quiet else mbd.check(mechanism).degrees_of_freedom
    if not options.quiet:
        print(summary(motion, {"degrees of freedom": str(freedom), "analysis": analysis.kind}))
        for note in notes:
            print(f"{'note':20}{note}")
        for path in _outputs(options).values():
            print(f"{'written':20}{path}")


def _analyse(mechanism: mbd.Mechanism, analysis: Analysis, options: argparse.Namespace) -> mbd.Trajectory:
    # a bar for people only: in a log or a pipe, standard error holds what went wrong and nothing else
    progress = not options.quiet and sys.stderr.isatty()
    if analysis.kind == "dynamics":
        settings: dict[str, Any] = {} if options.method is None else {"method": options.method}
        if options.tolerance is not None:
            settings |= {"reltol": options.tolerance, "abstol": options.tolerance}
        return mbd.simulate(mechanism, analysis.times, progress=progress, **settings)
    for name in ("method", "tolerance"):
        if getattr(options, name) is not None:
            raise mbd.MechanismError(f"--{name} is for dynamics; {options.analysis} asks for {analysis.kind}")
    return mbd.inverse_dynamics(mechanism, analysis.times, progress=progress)


def _check_outputs(outputs: dict[str, Path], inputs: Sequence[Path]) -> None:
    """Raise before the run if a file cannot be written, or would take the place of an input or of another output."""
    taken = {source.resolve(): "the input" for source in inputs}
    for kind, path in outputs.items():
        target = writable(path)
        for other, role in taken.items():
            if target == other or (target.exists() and other.exists() and target.samefile(other)):
                raise mbd.FileError(f"--{kind} {path}: this is the same file as {role} {other}; name another one")
        taken[target] = "the output"
    if "plot" in outputs:
        from matplotlib.figure import Figure

        formats = sorted(Figure().canvas.get_supported_filetypes())
        if outputs["plot"].suffix.lower().lstrip(".") not in formats:
            raise mbd.MechanismError(f"--plot {outputs['plot']}: the name must end in one of .{', .'.join(formats)}")
    if "animate" in outputs:
        from .visual.animation import check_ending

        check_ending(outputs["animate"])


def _write(motion: mbd.Trajectory, outputs: dict[str, Path]) -> None:
    """Write all outputs, or none of them."""
    writers: dict[str, Callable[[Path, Path], None]] = {
        "csv": lambda temporary, _: motion.to_csv(temporary),
        "plot": lambda temporary, path: _draw(motion, temporary, path.suffix.lower().lstrip(".")),
        "animate": lambda temporary, path: mbd.animate(motion).write(temporary, path.suffix.lower()),
        "save": lambda temporary, _: motion.save(temporary),
    }
    with ExitStack() as stack:
        for kind, path in outputs.items():
            writers[kind](stack.enter_context(whole_file(path)), path)


def _draw(motion: mbd.Trajectory, path: Path, kind: str) -> None:
    from .visual.plots.plot import overview

    overview(motion).savefig(path, format=kind, dpi=150)


@contextmanager
def _notes() -> Iterator[list[str]]:
    """Collect the package's warnings, which the summary prints; others go their usual way."""
    notes: list[str] = []
    with warnings.catch_warnings():
        warnings.simplefilter("always", mbd.MechanismWarning)
        usual = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *where: Any, **more: Any) -> None:
            if issubclass(category, mbd.MechanismWarning):
                notes.append(str(message))
            else:
                usual(message, category, *where, **more)

        warnings.showwarning = show
        yield notes


# --- check ---------------------------------------------------------------------------
def _check(options: argparse.Namespace) -> None:
    with _notes() as notes:
        report = mbd.check(read_model(options.model))
    print(report)
    for note in notes:
        print(f"note: {note}")


# --- export-fmu --------------------------------------------------------------------------
def _export_unit(options: argparse.Namespace) -> None:
    _check_outputs({"unit": options.unit}, (options.model, options.analysis))
    with _notes() as notes:
        mechanism = read_model(options.model)
        analysis = mbd.read_acf(options.analysis)
        inputs = {symbol.label for symbol in mechanism.inputs}
        named = default_expressions(mechanism, loads=True)
        outputs = {name: expression for name, expression in named.items() if name not in inputs}
        endings = {name: name.rsplit(".", 1)[-1] for name in outputs}
        mbd.export_fmu(
            mechanism,
            options.unit,
            outputs=outputs,
            units={name: UNITS[ending] for name, ending in endings.items() if ending in UNITS},
            kind=options.kind,
            version=options.version,
            stop=analysis.end,
            step=analysis.end / analysis.output_steps,
            binary=False if options.sources_only else None,
        )
    for note in notes:
        print(f"note: {note}")
    print(f"{'written':20}{options.unit}")


if __name__ == "__main__":
    sys.exit(main())
