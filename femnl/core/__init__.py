"""Values that the stages hand on, errors, compiled kernels, processes and resources: what everything else rests on."""
