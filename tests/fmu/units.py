"""Units in the hands of an importer: unpacked, instantiated, read and stepped by name."""

import tempfile
from itertools import pairwise
from pathlib import Path

import fmpy
import numpy as np
from fmpy.simulation import instantiate_fmu


class Unit:
    """An instance of a unit for co-simulation or model exchange, of either version.

    Messages of the unit are kept in ``said``.
    """

    def __init__(self, path: Path, folder: Path, kind: str = "CoSimulation"):
        # a folder of its own: the binary of another instance must not change under it
        self.folder = Path(tempfile.mkdtemp(dir=folder))
        fmpy.extract(str(path), str(self.folder))
        self.description = fmpy.read_model_description(str(path))
        self.is_2 = self.description.fmiVersion == "2.0"
        self.said: list[str] = []
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}
        self.fmu = instantiate_fmu(str(self.folder), self.description, kind, logger=self._logger)

    def _logger(self, *arguments):
        self.said.append(arguments[-1].decode() if isinstance(arguments[-1], bytes) else str(arguments[-1]))

    def start(self, time=0.0, stop=None, tolerance=None, **values):
        """Initialise with start values by name."""
        if self.is_2:
            self.fmu.setupExperiment(tolerance=tolerance, startTime=time, stopTime=stop)
            self.set(**values)
            self.fmu.enterInitializationMode()
        else:
            self.set(**values)
            self.fmu.enterInitializationMode(tolerance=tolerance, startTime=time, stopTime=stop)
        self.fmu.exitInitializationMode()
        self.time = time
        return self

    def set(self, **values):
        references = [self.references[name.replace("_", " ")] for name in values]
        if references:
            (self.fmu.setReal if self.is_2 else self.fmu.setFloat64)(references, list(values.values()))

    def get(self, *names):
        references = [self.references[name] for name in names]
        return np.array((self.fmu.getReal if self.is_2 else self.fmu.getFloat64)(references))

    def step(self, length):
        self.fmu.doStep(currentCommunicationPoint=self.time, communicationStepSize=length)
        self.time += length

    def run(self, times, *names):
        """Outputs (k, n) at times, from the present one on."""
        rows = [self.get(*names)]
        for begin, end in pairwise(times):
            self.time = begin
            self.step(end - begin)
            rows.append(self.get(*names))
        return np.array(rows)


def simulated(path, times, names, kind="CoSimulation", tolerance=1e-9, **values):
    """Outputs (k, n) of a whole run by FMPy."""
    step = float(times[1] - times[0])
    found = fmpy.simulate_fmu(
        str(path),
        fmi_type=kind,
        stop_time=float(times[-1]),
        output_interval=step,
        step_size=step if kind == "CoSimulation" else None,
        relative_tolerance=tolerance,
        start_values=values,
        output=list(names),
    )
    return np.column_stack([np.interp(times, found["time"], found[name]) for name in names])
