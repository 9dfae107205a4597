"""The film of geometry files on which tests lay layers."""

FILM = """
[film]
thickness = "100 nm"
young = "250 GPa"
poisson = 0.23
density = "3000 kg/m^3"
stress = "{stress}"
"""
