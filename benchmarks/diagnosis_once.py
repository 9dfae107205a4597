"""Diagnose one file with whatever femnl is found first, and print what that took.

Run `python benchmarks/diagnosis_once.py FILE [EFFECT]`; the library lacks EFFECT. It imports
nothing of this folder, so that `PYTHONPATH` chooses the code.
"""

import json
import resource
import sys
import time

from femnl.diagnose import diagnose, record
from femnl.effects import library

path, *gone = sys.argv[1:]
effects = [effect for name, effect in library().items() if name not in gone]
# The film's modes are solved, and kernels compiled, beforehand
diagnose(path, effects=[])
before = time.process_time()
found = record(diagnose(path, effects=effects))
answer = {
    "verdict": found["verdict"],
    "seconds": time.process_time() - before,
    "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**10,
}
sys.stdout.write(json.dumps(answer) + "\n")
