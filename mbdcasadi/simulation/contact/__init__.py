"""Contacts of a run: many of one kind in C, and those that close between two steps."""
