"""A controller that knows the state by an estimator alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NoReturn, Protocol

import numpy as np

from ..arguments.inputs import SampledController
from ..arguments.values import pairs_with
from ..errors import ModelError
from ..model.mechanism import Mechanism
from ..model.quantities import whole
from ..results.state import State
from .estimator import Estimator


class Feedback(Protocol):
    """What is fed: a :class:`Controller`."""

    mechanism: Mechanism
    period: float

    def inputs(self, state: State, parameters: Any = None) -> dict[Any, float]:
        """Inputs at a state."""

    @property
    def status(self) -> int | None:
        """Status of the last step."""

    def meaning(self, status: int) -> str:
        """What a status says."""

    def reset(self) -> None:
        """Forget the last motion."""


class FedController(SampledController):
    """What :meth:`Controller.fed_by` returns: at each sample an update of the estimator, then a step of the controller.

    Attributes
    ----------
    controller, estimator : Controller, Estimator
        Of which it is made.
    estimates : tuple of State
        What the controller was given at the samples of the last run.
    """

    def __init__(
        self, controller: Feedback, estimator: Estimator, covariance: Any, initial: State | None, seed: int | None
    ):
        if not isinstance(estimator, Estimator):
            raise ModelError(f"Controller.fed_by: takes an Estimator, got {estimator!r}")
        if abs(estimator.sample - controller.period) > 1e-9 * controller.period:
            raise ModelError(
                f"Controller.fed_by: the estimator takes samples every {estimator.sample:g} s, the controller every "
                f"{controller.period:g} s; give both the same"
            )
        if seed is not None:
            seed = whole(seed, "Controller.fed_by", "seed", 0)
        super().__init__(self._answer, controller.period)
        self.controller, self.estimator = controller, estimator
        self._covariance, self._initial, self._seed = covariance, initial, seed
        self._run = dict[str, Any](estimates=[])

    @property
    def estimates(self) -> tuple[State, ...]:
        """Estimates at the samples of the last run."""
        return tuple(self._run["estimates"])

    @property
    def status(self) -> int | None:
        """Status of the last step of the controller."""
        return self.controller.status

    def meaning(self, status: int) -> str:
        """Return what a status of the controller says."""
        return self.controller.meaning(status)

    def export(self, folder: str | Path) -> NoReturn:
        """Refuse: estimators run in Python. :meth:`Controller.export` writes the controller alone."""
        raise ModelError(
            "FedController.export: the estimator runs in Python and is not written as C; "
            f"controller.export({folder!r}) writes the controller, which takes a state from an estimator of your own"
        )

    def _answer(self, time: float, state: State) -> dict[Any, float]:
        """Inputs in a run; a time that does not follow the last one begins a new motion."""
        run, estimator, controller = self._run, self.estimator, self.controller
        due = run.get("due")
        if due is None or abs(time - due) > 1e-6 * self.period:
            controller.reset()
            run.update(estimates=[], noise=None if self._seed is None else np.random.default_rng(self._seed))
            estimate = state if self._initial is None else self._initial
            estimator.reset(estimate, self._covariance)
        else:
            measured = np.atleast_1d(state[estimator.measured])
            if run["noise"] is not None:
                measured = measured + run["noise"].normal(0, estimator.noise)
            estimate = estimator.update(measured, run["inputs"])
        found = [(k, estimate[k]) for k in estimator.unknown]
        values = pairs_with(controller.mechanism.parameters, found)
        run["inputs"] = controller.inputs(estimate, values)
        run["due"] = time + self.period
        run["estimates"].append(estimate)
        answer: dict[Any, float] = run["inputs"]
        return answer
