"""Schemes of collocation, one a file; :data:`TRANSCRIPTIONS` lists them."""

from .base import Transcription
from .gauss_legendre import GaussLegendre
from .hermite_simpson import HermiteSimpson

#: Schemes by the name that ``transcription=`` takes.
TRANSCRIPTIONS: dict[str, type[Transcription]] = {scheme.name: scheme for scheme in (GaussLegendre, HermiteSimpson)}
