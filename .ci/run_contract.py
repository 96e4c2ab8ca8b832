"""Run a contract script as it is, up to the first block that a later issue covers."""

import sys
from pathlib import Path

#: Comment line with which that block begins, by script.
LATER = {"bad_input.py": "# an optimal-control problem that has no solution"}

path = Path(sys.argv[1]).resolve()
text = path.read_text(encoding="utf-8")
if path.name in LATER:
    text, found, _ = text.partition("\n" + LATER[path.name])
    if not found:
        sys.exit(f"{path} has no line {LATER[path.name]!r}; mend the list in {Path(__file__).name}")
    print(f"{path.name}: up to the line {LATER[path.name]!r}")
exec(compile(text, str(path), "exec"), {"__name__": "__main__", "__file__": str(path)})
