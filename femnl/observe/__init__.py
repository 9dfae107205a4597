"""One package a kind of measurement: what a model of the device predicts of its data."""
