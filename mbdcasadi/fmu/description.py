"""The XML files of a unit: ``modelDescription.xml``, and ``buildDescription.xml`` of FMI 3.0."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as ET

import numpy as np

from .functions import Model
from .variables import UNITS, Variable, Variables


@dataclass(frozen=True, eq=False)
class Description:
    """Contents of the XML files of a unit.

    Attributes
    ----------
    model : Model
        The model.
    variables : Variables
        Its variables.
    name, identifier : str
        Name of the model, and of its functions in C.
    token : str
        Digest of everything in the unit.
    kinds : frozenset of str
        Of "co-simulation" and "model-exchange".
    sources : sequence of str
        C files that are compiled.
    reltol, start, stop, step : float or None
        Of the default experiment.
    tool : str
        The package with its version.
    """

    model: Model
    variables: Variables
    name: str
    identifier: str
    token: str
    kinds: frozenset[str]
    sources: Sequence[str]
    reltol: float
    start: float
    stop: float | None
    step: float | None
    tool: str

    # --- FMI 2.0 -------------------------------------------------------------------------
    def version_2(self) -> bytes:
        """``modelDescription.xml`` of FMI 2.0."""
        v = self.variables
        listed = [x for x in v.all if x not in v.indicators]
        index = {variable.reference: str(k) for k, variable in enumerate(listed, start=1)}
        root = ET.Element("fmiModelDescription", self._head("2.0") | {"guid": self.token})
        root.set("numberOfEventIndicators", str(len(v.indicators)))
        able = {"canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true", "providesDirectionalDerivative": "true"}
        for kind, tag, more in (
            ("model-exchange", "ModelExchange", {"completedIntegratorStepNotNeeded": "true"}),
            (
                "co-simulation",
                "CoSimulation",
                {"canHandleVariableCommunicationStepSize": "true", "canInterpolateInputs": "true"},
            ),
        ):
            if kind in self.kinds:
                attributes = {
                    "modelIdentifier": self.identifier,
                    **more,
                    **able,
                    "providesDirectionalDerivative": "true",
                }
                files = ET.SubElement(ET.SubElement(root, tag, attributes), "SourceFiles")
                for source in self.sources:
                    ET.SubElement(files, "File", {"name": source})
        self._common(root)
        variables = ET.SubElement(root, "ModelVariables")
        for variable in listed:
            attributes = self._attributes(variable)
            scalar = ET.SubElement(variables, "ScalarVariable", attributes)
            numbers = self._numbers(variable)
            if variable.rate_of is not None:
                numbers["derivative"] = index[variable.rate_of]
            ET.SubElement(scalar, "Real", numbers)
        structure = ET.SubElement(root, "ModelStructure")
        of_rates, of_outputs = self._dependencies({r: index[r] for r in index})
        for tag, unknowns, dependencies in (
            ("Outputs", v.outputs, of_outputs),
            ("Derivatives", v.rates, of_rates),
            ("InitialUnknowns", sorted((*v.outputs, *v.states, *v.rates), key=lambda x: x.reference), None),
        ):
            if unknowns:
                part = ET.SubElement(structure, tag)
                for k, variable in enumerate(unknowns):
                    entry = {"index": index[variable.reference]}
                    if dependencies is not None:
                        entry["dependencies"] = dependencies[k]
                    ET.SubElement(part, "Unknown", entry)
        return _text(root)

    # --- FMI 3.0 -------------------------------------------------------------------------
    def version_3(self) -> bytes:
        """``modelDescription.xml`` of FMI 3.0."""
        v = self.variables
        root = ET.Element("fmiModelDescription", self._head("3.0") | {"instantiationToken": self.token})
        able = {
            "canGetAndSetFMUState": "true",
            "canSerializeFMUState": "true",
            "providesDirectionalDerivatives": "true",
        }
        if "model-exchange" in self.kinds:
            attributes = {"modelIdentifier": self.identifier, "needsCompletedIntegratorStep": "false", **able}
            ET.SubElement(root, "ModelExchange", attributes)
        if "co-simulation" in self.kinds:
            more = {"canHandleVariableCommunicationStepSize": "true"}
            ET.SubElement(root, "CoSimulation", {"modelIdentifier": self.identifier, **more, **able})
        self._common(root)
        variables = ET.SubElement(root, "ModelVariables")
        for variable in v.all:
            attributes = self._attributes(variable) | self._numbers(variable)
            if variable.rate_of is not None:
                attributes["derivative"] = str(variable.rate_of)
            ET.SubElement(variables, "Float64", attributes)
        structure = ET.SubElement(root, "ModelStructure")
        of_rates, of_outputs = self._dependencies({x.reference: str(x.reference) for x in v.all})
        for tag, unknowns, dependencies in (
            ("Output", v.outputs, of_outputs),
            ("ContinuousStateDerivative", v.rates, of_rates),
            ("InitialUnknown", (*v.outputs, *v.states, *v.rates), None),
            ("EventIndicator", v.indicators, None),
        ):
            for k, variable in enumerate(unknowns):
                entry = {"valueReference": str(variable.reference)}
                if dependencies is not None:
                    entry["dependencies"] = dependencies[k]
                ET.SubElement(structure, tag, entry)
        return _text(root)

    def build(self) -> bytes:
        """``buildDescription.xml`` of FMI 3.0."""
        root = ET.Element("fmiBuildDescription", {"fmiVersion": "3.0"})
        configuration = ET.SubElement(root, "BuildConfiguration", {"modelIdentifier": self.identifier})
        files = ET.SubElement(configuration, "SourceFileSet", {"language": "C11"})
        for source in self.sources:
            ET.SubElement(files, "SourceFile", {"name": source})
        return _text(root)

    # --- both ---------------------------------------------------------------------------
    def _head(self, version: str) -> dict[str, str]:
        return {
            "fmiVersion": version,
            "modelName": self.name,
            "description": "Planar mechanism of rigid bodies",
            "generationTool": self.tool,
            "variableNamingConvention": "flat",
        }

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
        experiment = {"startTime": self.start, "stopTime": self.stop, "tolerance": self.reltol, "stepSize": self.step}
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
        found = {"unit": variable.unit} if variable.unit else {}
        for key, value in (("min", variable.lower), ("max", variable.upper)):
            if np.isfinite(value):
                found[key] = repr(float(value))
        if variable.nominal != 1.0:
            found["nominal"] = repr(variable.nominal)
        if variable.start is not None:
            found["start"] = repr(variable.start)
        return found

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
