"""Lists of linkages in files."""

from __future__ import annotations

from pathlib import Path

from ..equations import equations
from ..errors import FileError
from ..model.mechanism import Mechanism
from ..numerics.least_squares import largest
from ..results.archives import read_arrays
from .linkage import Linkage, Shared
from .linkages import FORMAT, Linkages, Search

#: Gap of a joint, over the size of the coordinates, from which a linkage belongs to another mechanism.
APART = 1e-6


def read_linkages(path: str | Path, mechanism: Mechanism) -> Linkages:
    """Read a list that :meth:`Linkages.save` wrote.

    Parameters
    ----------
    path : str or Path
        The file.
    mechanism : Mechanism
        That of the synthesis; its parameters are known by their names.

    Raises
    ------
    FileError
        If the file cannot be read, or belongs to another mechanism.
    """
    equations(mechanism)  # raises for what is not a mechanism
    archive = read_arrays(path, FORMAT, "linkages", "Linkages.save")
    labels = archive.names("unknowns")
    by_label = {p.label: p for p in mechanism.parameters}
    if missing := [label for label in labels if label not in by_label]:
        raise FileError(f"{path}: the mechanism has no parameter '{missing[0]}', which the linkages of the file have")
    shared = Shared(mechanism, tuple(by_label[label] for label in labels))
    search = Search(**archive.json("search"))
    values = archive.numbers("values", None, len(labels))
    count = len(values)
    poses = archive["poses"] if not count else archive.numbers("poses", count, None, shared.poses.turning.size)
    residuals, found, family = (archive.numbers(name, count) for name in ("residuals", "found", "family"))
    misses = archive.json_list("misses", count)
    linkages = [
        Linkage(shared, *one)
        for one in zip(values, poses, misses, *(x.tolist() for x in (residuals, found, family)), strict=True)
    ]
    for linkage in linkages:
        if not linkage.gap <= APART * max(1.0, largest(linkage.poses)):
            raise FileError(f"{path}: the joints of the mechanism do not meet with these dimensions; it is another one")
    return Linkages(linkages, search)
