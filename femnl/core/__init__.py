"""Values that the stages hand on, errors, compiled kernels, processes and resources.

What everything else rests on.
"""
