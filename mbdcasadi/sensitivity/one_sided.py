"""Warnings of derivatives that hold to one side alone."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from ..equations.switching.switches import Switch
from ..errors import warn
from .cuts import Cut


class OneSidedWarnings:
    """Warnings of switches at which the derivatives to both sides differ: at an output, or several at one instant.

    Parameters
    ----------
    unmoved : collection of int
        Switches in time whose instants no parameter moves: these have no derivative of their own.
    differentiates : bool, default True
        False if nothing is differentiated, and nothing is to be said.
    """

    def __init__(self, unmoved: Collection[int], *, differentiates: bool = True):
        self._unmoved, self._warned = frozenset(unmoved), set[str]()
        self._differentiates = differentiates

    def report(self, cuts: Sequence[Cut], switches: Sequence[Switch]) -> None:
        """Warn of the cuts of a motion by some switches."""
        together: list[str] = []
        previous: Cut | None = None
        for cut in (c for c in cuts if c.switches):
            first = switches[cut.switches[0]]
            names = [first.description] if first.node not in self._unmoved else []
            together = together if previous is not None and cut.joined and cut.time == previous.time else []
            previous, before = cut, together
            together = [*before, *names]
            if before and names:
                self._warn_once(
                    f"{' and '.join(dict.fromkeys(together))} jump together at t = {cut.time:.6g} s, in an order that "
                    "changes with the parameters: derivatives from there on hold for the order taken, to one side alone"
                )
            elif names and cut.at_output:
                self.at_output(names[0], cut.time)

    def at_output(self, name: str, time: float) -> None:
        """Warn of a switch at an output."""
        self._warn_once(
            f"{name} jumps at the output t = {time:.6g} s: derivatives at this output are those before the jump, to "
            "one side alone; move the output off the jump"
        )

    def _warn_once(self, sentence: str) -> None:
        if self._differentiates and sentence not in self._warned:
            self._warned.add(sentence)
            warn(sentence)
