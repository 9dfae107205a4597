"""How the laboratory computes the causes of sweeps."""

DERIVED: dict[str, str] = {
    "crosstalk": "a constant added to the voltage",
    "detector_saturation": "a clipped sinusoid, sampled over a period",
    "drive_compression": "the force in time steps of the slow flow",
    "fano_background": "a driven oscillator of second order in f, beside the mode",
    "frequency_drift": "f₀ at each time step of the sweeps",
    "group_delay": "a late sinusoid, sampled over a period",
    "internal_resonance": "time steps of both modes",
    "lock_in_filter": "RC stages in time steps by the midpoint rule",
    "nonlinear_damping": "time steps of the slow flow",
    "nonlinear_readout": "a sine of the motion, sampled, with the shapes of another method",
    "one_sided_saturation": "a sinusoid clipped on one side, sampled over a period",
    "quadratic_stiffness": "the frequency of the free oscillation between its turning points",
    "quintic_stiffness": "time steps of the slow flow",
    "sloping_background": "the flank of a driven oscillator, of second order in f",
    "unsettled_mode": "time steps of the slow flow for the time of each point",
}
"""How the laboratory computes each cause."""
