"""Drawings, plots, films, and pages for the browser."""
