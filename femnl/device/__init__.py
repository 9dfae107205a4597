"""Devices: geometry files and meshes of them."""
