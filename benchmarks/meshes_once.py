"""Mesh one device with whatever femnl is found first, and print what that took.

Run `python benchmarks/meshes_once.py NAME_OR_FILE`. It imports nothing of this folder, so that
`PYTHONPATH` chooses the code.
"""

import json
import sys
import time

import gmsh

from femnl.device.geometry import load
from femnl.device.mesh import mesh

model = load(sys.argv[1])
# gmsh loads its library with the first model
gmsh.initialize(interruptible=False)
gmsh.finalize()
before = time.process_time()
made = mesh(model)
answer = {"seconds": time.process_time() - before, "triangles": made.mesh.nelements}
sys.stdout.write(json.dumps(answer) + "\n")
