"""Records: drive and output of one oscillator, sampled in time."""
