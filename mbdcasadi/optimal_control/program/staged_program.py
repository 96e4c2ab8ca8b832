"""A program in the form of an optimal-control problem in stages, which fatrop solves.

The intervals of the mesh, of all phases in turn, are the stages. A variable is an input of the first stage whose rows
or cost contain it, and a state of the following ones up to the last: mesh points, times, free parameters and impulses
alike. The stages are joined by rows that carry the states over, and all other rows stay what they are. So every
transcription has this structure, and multipliers mean the same as in the program.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from ...numerics.lazy import cached_property
from .sparse_program import MappedBlock, SparseProgram

#: Phase and interval of the mesh.
Interval = tuple[int, int]


class StagedProgram:
    """A program whose variables and rows are ordered by stage.

    `copies` are the intervals that each copy of the pieces sees, `intervals` those of all phases in turn.
    """

    def __init__(
        self,
        program: SparseProgram,
        copies: Sequence[Sequence[tuple[Interval, ...]]],
        intervals: Sequence[Interval],
    ):
        pieces = program.pieces
        seen = [_seen(piece) for piece in pieces]
        stage = {interval: k for k, interval in enumerate(intervals)}
        last_stages = [np.array([max((stage[i] for i in copy), default=-1) for copy in of]) for of in copies]
        homes = _homes(program, seen, last_stages)
        count = 1 + max(int(home.max()) for home in homes)
        first, last = _spans(program.size, pieces, seen, homes)
        stages = np.arange(count)[:, None]
        is_state, is_input = (first < stages) & (stages <= last), first == stages
        #: states, inputs and rows by stage; the rows that carry states over are not counted
        self.nx, self.nu = is_state.sum(axis=1).tolist(), is_input.sum(axis=1).tolist()
        ordered = [np.flatnonzero(x) for pair in zip(is_state, is_input, strict=True) for x in pair]
        #: variable of the program that each variable is a copy of
        self._original = np.concatenate(ordered)
        self.size = self._original.size
        places = np.zeros((count, program.size), int)
        places[np.repeat(stages.ravel(), np.add(self.nx, self.nu)), self._original] = np.arange(self.size)
        #: place of each variable of the program as an input
        self._as_input = places[first, np.arange(program.size)]
        moved = []
        for piece, rows, home in zip(pieces, seen, homes, strict=True):
            index = self._as_input[piece.index]
            index[rows] = places[home, piece.index[rows]]
            moved.append(replace(piece, index=index))
        self._nlp = SparseProgram(self.size, moved, program.parameters)
        arrives, variable = np.nonzero(is_state)
        self._gaps = _differences(places[arrives, variable], places[arrives - 1, variable], self.size)
        home = np.concatenate([np.repeat(home, piece.rows.numel()) for home, piece in zip(homes, pieces, strict=True)])
        self.ng = np.bincount(home, minlength=count).tolist()
        #: rows of the program and then those that carry states over, in the order of the stages, these first
        self._order = np.lexsort((np.r_[np.ones(home.size), np.zeros(arrives.size)], np.r_[home, arrives - 1]))
        self._places_of_rows = np.argsort(self._order)[: home.size]

    # --- functions of CasADi ---------------------------------------------------------------
    @cached_property
    def gradient(self) -> ca.Function:
        """Gradient of the cost as fatrop takes it."""
        x, p = ca.MX.sym("x", self.size), ca.MX.sym("p", self._nlp.data_size)
        gradient = self._nlp.derivatives["grad_f"](x, p)[1]
        return ca.Function("nlp_grad_f", [x, p], [gradient], ["x", "p"], ["grad_f_x"])

    @cached_property
    def derivatives(self) -> list[ca.Function]:
        """Derivatives of rows and Lagrangian as fatrop takes them; all solvers of the program share them."""
        nlp, derivatives, order = self._nlp, self._nlp.derivatives, self._order.tolist()
        x, p = ca.MX.sym("x", self.size), ca.MX.sym("p", nlp.data_size)
        lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", self._order.size)
        rows, jacobian = derivatives["jac_g"](x, p)
        every_row = ca.vertcat(rows, ca.mtimes(self._gaps, x))[order]
        every_slope = ca.vertcat(jacobian, ca.MX(self._gaps))[order, :]
        by_origin = lam_g[np.argsort(self._order).tolist()]
        of_rows, of_gaps = ca.vertsplit(by_origin, [0, nlp.row_count, self._order.size])
        hessian = ca.triu2symm(derivatives["hess_lag"](x, p, lam_f, of_rows))
        gradient = nlp.lagrangian_gradient(x, p, lam_f, of_rows) + ca.mtimes(self._gaps.T, of_gaps)
        names = ["x", "p"]
        lagrangian = ["grad_gamma_x", "hess_gamma_x_x"]
        return [
            ca.Function("nlp_jac_g", [x, p], [every_row, every_slope], names, ["g", "jac_g_x"]),
            ca.Function(
                "nlp_hess_l", [x, p, lam_f, lam_g], [gradient, hessian], [*names, "lam_f", "lam_g"], lagrangian
            ),
        ]

    @cached_property
    def evaluate(self) -> ca.Function:
        """``(x, p) -> (cost, rows)``, the rows in the order of the program."""
        return self._nlp.evaluate

    def solver(self, options: dict[str, Any], gradient: ca.Function | None = None) -> ca.Function:
        """Fatrop with all derivatives given; `gradient` may stand in for that of the cost."""
        x, p = ca.MX.sym("x", self.size), ca.MX.sym("p", self._nlp.data_size)
        cost, rows = self.evaluate(x, p)
        every_row = ca.vertcat(rows, ca.mtimes(self._gaps, x))[self._order.tolist()]
        structure = {
            "structure_detection": "manual",
            "N": len(self.nx) - 1,
            "nx": self.nx,
            "nu": self.nu,
            "ng": self.ng,
        }
        known = {function.name(): function for function in [*self.derivatives, gradient or self.gradient]}
        nlp = {"x": x, "p": p, "f": cost, "g": every_row}
        return ca.nlpsol("motion", "fatrop", nlp, structure | {"cache": known} | options)

    # --- arguments and answers ---------------------------------------------------------------
    def arguments(self, arguments: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Arguments of a solver of the program as those of :meth:`solver`, which takes no multipliers."""
        taken = {"p": arguments["p"], "x0": arguments["x0"][self._original]}
        for name, free in (("lbx", -np.inf), ("ubx", np.inf)):
            taken[name] = np.full(self.size, free)
            taken[name][self._as_input] = arguments[name]
        gaps = np.zeros(self._gaps.size1())
        return taken | {name: np.r_[arguments[name], gaps][self._order] for name in ("lbg", "ubg")}

    def answer(self, answer: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Answer of :meth:`solver` as that of a solver of the program."""
        of_variables = {name: answer[name][self._as_input] for name in ("x", "lam_x")}
        return of_variables | {name: answer[name][self._places_of_rows] for name in ("g", "lam_g")} | {"f": answer["f"]}


def _seen(piece: MappedBlock) -> np.ndarray:
    """Variables of a piece, by place in it, that its rows or its cost contain."""
    pattern = piece.jacobian(ca.vertcat(piece.rows, piece.cost)).sparsity()
    return np.unique(np.array(pattern.get_triplet()[1], int))


def _homes(program: SparseProgram, seen: list[np.ndarray], homes: list[np.ndarray]) -> list[np.ndarray]:
    """Stages of the copies, by piece; those that are -1 are the ones in which the last variable of the copy appears."""
    first, _ = _spans(program.size, program.pieces, seen, homes)
    for piece, rows, home in zip(program.pieces, seen, homes, strict=True):
        for k in np.flatnonzero(home < 0):
            home[k] = first[piece.index[rows, k]].max()
    return homes


def _spans(
    size: int, pieces: list[MappedBlock], seen: list[np.ndarray], homes: list[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """First and last stage of each variable; the first one for what nothing contains."""
    first, last = np.full(size, np.iinfo(int).max), np.full(size, -1)
    for piece, rows, home in zip(pieces, seen, homes, strict=True):
        known = home >= 0
        places = piece.index[rows][:, known]
        stages = np.broadcast_to(home[known], places.shape)
        np.minimum.at(first, places, stages)
        np.maximum.at(last, places, stages)
    nowhere = last < 0
    first[nowhere] = last[nowhere] = 0
    return first, last


def _differences(places: np.ndarray, subtracted: np.ndarray, size: int) -> ca.DM:
    """Matrix of rows that are a variable minus another one."""
    rows, ones = np.arange(places.size), np.ones(places.size)
    return ca.DM.triplet([*rows, *rows], [*places, *subtracted], [*ones, *-ones], places.size, size)
