"""A live page as a widget of a notebook, whose values go both ways."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files
from typing import Any

from ...errors import MechanismError
from ...model.symbols import number
from ...numerics.lazy import optional_package
from .live_model import Slider


def page_widget(html: str, sliders: Sequence[Slider], height: int) -> Any:
    """Return the widget of a page; see :meth:`LiveAnimation.widget`.

    Parameters
    ----------
    html : str
        The page.
    sliders : sequence of Slider
        What its values may be.
    height : int
        Height, pixels.
    """
    anywidget = optional_package("anywidget", "widget", "notebook")
    traitlets = optional_package("traitlets", "widget", "notebook")
    limits = {slider.name: (slider.low, slider.high) for slider in sliders}

    class PageWidget(anywidget.AnyWidget):  # type: ignore[name-defined]
        _esm = (files(__package__) / "template" / "live" / "widget.js").read_text(encoding="utf-8")
        html = traitlets.Unicode().tag(sync=True)
        height = traitlets.Int().tag(sync=True)
        values = traitlets.Dict().tag(sync=True)
        playing = traitlets.Bool(False).tag(sync=True)
        time = traitlets.Float().tag(sync=True)
        q = traitlets.List().tag(sync=True)
        v = traitlets.List().tag(sync=True)

        @traitlets.validate("values")
        def _checked(self, proposal: Any) -> dict[str, float]:
            for name, value in proposal["value"].items():
                if name not in limits:
                    raise MechanismError(f"widget: there is no slider '{name}'; there are {_listed(limits)}")
                low, high = limits[name]
                if not low <= number(value, "widget", f"'{name}'") <= high:
                    raise MechanismError(f"widget: '{name}' goes from {low:g} to {high:g}, got {value:g}")
            return self.values | proposal["value"]

    return PageWidget(html=html, height=height, values={slider.name: slider.value for slider in sliders})


def _listed(names: Any) -> str:
    return ", ".join(f"'{name}'" for name in names) or "none"
