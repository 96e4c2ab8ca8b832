"""Contacts in a run: many of one kind in C, and contacts that close between two steps."""
