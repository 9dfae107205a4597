"""The finite-element ground: elements, weak forms, supports, solvers."""
