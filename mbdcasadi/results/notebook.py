"""Results as HTML tables, for notebooks."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape


def html_table(title: str, rows: Sequence[Sequence[str]], header: Sequence[str] = (), notes: Sequence[str] = ()) -> str:
    """Return a table with a title; text is escaped, and colours are those of the page around it.

    Parameters
    ----------
    title : str
        Line above the table.
    rows : sequence of sequence of str
        Cells; the first of a row is its name, and of a row with several others these are numbers.
    header : sequence of str
        Names of the columns.
    notes : sequence of str
        Lines below the table.

    Examples
    --------
    >>> html_table("Fit", [["k", "2.5"]], ["", "value"])[:53]
    '<div><p style="margin:0 0 4px"><b>Fit</b></p><table><'
    """
    numeric = any(len(row) > 2 for row in rows)
    parts = [f'<div><p style="margin:0 0 4px"><b>{escape(title)}</b></p><table>']
    if header:
        parts.append("<thead><tr>" + "".join(f"<th>{escape(name)}</th>" for name in header) + "</tr></thead>")
    side = "right" if numeric else "left"
    cell = f'<td style="text-align:{side}">'
    for row in rows:
        name, *others = (escape(text) for text in row)
        cells = "".join(f"{cell}{text}</td>" for text in others)
        parts.append(f'<tr><th style="text-align:left">{name}</th>{cells}</tr>')
    parts.append("</table>")
    parts += [f'<p style="margin:2px 0">{escape(note)}</p>' for note in notes]
    return "".join([*parts, "</div>"])
