"""Diagnose one file in two processes with whatever femnl is found first, and print the verdict.

Run `python benchmarks/diagnosis_once.py FILE [EFFECT]`; the library lacks EFFECT. It imports
nothing of this folder, so that `PYTHONPATH` chooses the code. Memory is that of this process.
"""

import json
import resource
import sys

from femnl.diagnose import diagnose, record
from femnl.effects import library

if __name__ == "__main__":
    path, *gone = sys.argv[1:]
    effects = [effect for name, effect in library().items() if name not in gone]
    found = record(diagnose(path, effects=effects, workers=2))
    answer = {
        "verdict": found["verdict"],
        "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**10,
    }
    sys.stdout.write(json.dumps(answer) + "\n")
