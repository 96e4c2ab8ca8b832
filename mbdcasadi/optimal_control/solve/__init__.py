"""One solve of a program: solvers, records, explanations of failures."""
