"""The XML files of a unit: ``modelDescription.xml``, and ``buildDescription.xml`` of FMI 3.0."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from xml.etree import ElementTree as ET

import numpy as np

from ..integrators.native.code import package_version
from .functions import Model
from .variables import UNITS, Variable, Variables

#: Kinds of simulation.
KINDS = ("co-simulation", "model-exchange")
#: Capabilities by version: those of one kind of simulation, and of both.
_ABILITIES: dict[int, dict[str, dict[str, str]]] = {
    2: {
        "ModelExchange": {"completedIntegratorStepNotNeeded": "true"},
        "CoSimulation": {"canHandleVariableCommunicationStepSize": "true", "canInterpolateInputs": "true"},
        "both": dict.fromkeys(
            ("canGetAndSetFMUstate", "canSerializeFMUstate", "providesDirectionalDerivative"), "true"
        ),
    },
    3: {
        "ModelExchange": {"needsCompletedIntegratorStep": "false"},
        "CoSimulation": {"canHandleVariableCommunicationStepSize": "true"},
        "both": dict.fromkeys(
            ("canGetAndSetFMUState", "canSerializeFMUState", "providesDirectionalDerivatives"), "true"
        ),
    },
}


@dataclass(frozen=True, eq=False)
class Unit:
    """A functional mock-up unit, and the XML files that describe it.

    Attributes
    ----------
    model : Model
        The model.
    variables : Variables
        Its variables.
    name : str
        Name of the model.
    version : int
        2 or 3.
    kinds : frozenset of str
        Of "co-simulation" and "model-exchange".
    reltol, abstol : float
        Tolerances in co-simulation, if the importer gives none.
    stop, step : float or None
        End and communication step of the default experiment, s.
    is_differentiable : bool
        Whether it gives directional derivatives, and takes slopes of inputs.
    """

    model: Model
    variables: Variables
    name: str
    version: int
    kinds: frozenset[str]
    reltol: float
    abstol: float
    stop: float | None
    step: float | None
    is_differentiable: bool = True

    @property
    def identifier(self) -> str:
        """Name as one of C."""
        clean = re.sub(r"[^A-Za-z0-9]+", "_", self.name).strip("_")[:60]
        return clean if re.match(r"[A-Za-z]", clean) else f"mechanism_{clean}".rstrip("_")

    @property
    def compiled(self) -> list[str]:
        """C files that are compiled, which include the others."""
        return ["equations.c", f"fmi{self.version}.c"]

    def model_description(self, token: str) -> bytes:
        """``modelDescription.xml``, with a digest of everything in the unit."""
        v, is_3 = self.variables, self.version == 3
        listed = v.all if is_3 else v.all[: len(v.all) - len(v.indicators)]
        # variables are referred to by their value references, in FMI 2.0 by their places from 1 on
        places = {x.reference: str(x.reference if is_3 else k) for k, x in enumerate(listed, start=1)}
        root = ET.Element("fmiModelDescription", self._head(token))
        self._kinds(root)
        self._common(root)
        variables = ET.SubElement(root, "ModelVariables")
        for variable in listed:
            attributes, numbers = self._attributes(variable), self._numbers(variable)
            if variable.rate_of is not None:
                numbers["derivative"] = places[variable.rate_of]
            if is_3:
                ET.SubElement(variables, "Float64", attributes | numbers)
            else:
                ET.SubElement(ET.SubElement(variables, "ScalarVariable", attributes), "Real", numbers)
        structure = ET.SubElement(root, "ModelStructure")
        of_rates, of_outputs = self._dependencies(places)
        for tag, unknowns, dependencies in (
            ("Output", v.outputs, of_outputs),
            ("ContinuousStateDerivative" if is_3 else "Derivative", v.rates, of_rates),
            ("InitialUnknown", (*v.outputs, *v.states, *v.rates), None),
            ("EventIndicator", v.indicators if is_3 else (), None),
        ):
            part = structure if is_3 or not unknowns else ET.SubElement(structure, f"{tag}s")
            for k, variable in enumerate(unknowns):
                entry = {"valueReference" if is_3 else "index": places[variable.reference]}
                if dependencies is not None:
                    entry["dependencies"] = dependencies[k]
                ET.SubElement(part, tag if is_3 else "Unknown", entry)
        return _text(root)

    def build_description(self) -> bytes:
        """``buildDescription.xml`` of FMI 3.0."""
        root = ET.Element("fmiBuildDescription", {"fmiVersion": "3.0"})
        configuration = ET.SubElement(root, "BuildConfiguration", {"modelIdentifier": self.identifier})
        files = ET.SubElement(configuration, "SourceFileSet", {"language": "C11"})
        for source in self.compiled:
            ET.SubElement(files, "SourceFile", {"name": source})
        return _text(root)

    # --- parts of the description of the model ------------------------------------------------
    def _head(self, token: str) -> dict[str, str]:
        head = {
            "fmiVersion": f"{self.version}.0",
            "modelName": self.name,
            "description": "Planar mechanism of rigid bodies",
            "generationTool": f"mbdcasadi {package_version()}",
            "variableNamingConvention": "flat",
        }
        if self.version == 3:
            return head | {"instantiationToken": token}
        return head | {"guid": token, "numberOfEventIndicators": str(len(self.variables.indicators))}

    def _kinds(self, root: ET.Element) -> None:
        """Kinds of simulation with their capabilities, and in FMI 2.0 the sources."""
        for kind in KINDS[::-1]:
            if kind in self.kinds:
                tag = kind.title().replace("-", "")
                abilities = _ABILITIES[self.version][tag] | _ABILITIES[self.version]["both"]
                if not self.is_differentiable:
                    abilities = {
                        name: able
                        for name, able in abilities.items()
                        if "Derivative" not in name and name != "canInterpolateInputs"
                    }
                element = ET.SubElement(root, tag, {"modelIdentifier": self.identifier, **abilities})
                if self.version == 2:
                    files = ET.SubElement(element, "SourceFiles")
                    for source in self.compiled:
                        ET.SubElement(files, "File", {"name": source})

    def _common(self, root: ET.Element) -> None:
        """Units, categories of messages and default experiment."""
        units = sorted({x.unit for x in self.variables.all if x.unit})
        if units:
            definitions = ET.SubElement(root, "UnitDefinitions")
            for name in units:
                unit = ET.SubElement(definitions, "Unit", {"name": name})
                if name in UNITS:
                    ET.SubElement(unit, "BaseUnit", {key: f"{value:.17g}" for key, value in UNITS[name].items()})
        categories = ET.SubElement(root, "LogCategories")
        for name in ("logStatusWarning", "logStatusDiscard", "logStatusError"):
            ET.SubElement(categories, "Category", {"name": name})
        experiment = {
            "startTime": self.model.start.t,
            "stopTime": self.stop,
            "tolerance": self.reltol,
            "stepSize": self.step,
        }
        known = {key: f"{value:.17g}" for key, value in experiment.items() if value is not None}
        ET.SubElement(root, "DefaultExperiment", known)

    def _attributes(self, variable: Variable) -> dict[str, str]:
        attributes = {
            "name": variable.name,
            "valueReference": str(variable.reference),
            "causality": variable.causality,
            "variability": "tunable" if variable.causality == "parameter" else "continuous",
        }
        if variable.causality in ("output", "local"):
            attributes["initial"] = "calculated"
        elif variable.causality == "parameter":
            attributes["initial"] = "exact"
        return attributes

    def _numbers(self, variable: Variable) -> dict[str, str]:
        attributes = {"unit": variable.unit} if variable.unit else {}
        for key, value in (("min", variable.lower), ("max", variable.upper)):
            if np.isfinite(value):
                attributes[key] = repr(float(value))
        if variable.nominal != 1.0:
            attributes["nominal"] = repr(variable.nominal)
        if variable.start is not None:
            attributes["start"] = repr(variable.start)
        return attributes

    def _dependencies(self, places: Mapping[int, str]) -> tuple[list[str], list[str]]:
        """References of the states and inputs on which rates and outputs depend."""
        v = self.variables
        n_x = len(v.states)
        known = [*v.states, *v.inputs]
        columns = [*range(n_x), *(n_x + k for k in v.input_places)]

        def named(pattern: np.ndarray) -> list[str]:
            return [
                " ".join(
                    sorted((places[x.reference] for x, on in zip(known, row[columns], strict=True) if on), key=int)
                )
                for row in pattern
            ]

        rates, outputs = self.model.dependencies
        return named(rates), named(outputs)


def _text(root: ET.Element) -> bytes:
    ET.indent(root)
    text: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return text + b"\n"
