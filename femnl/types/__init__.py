"""The values that pass between femnl's stages: frozen dataclasses in SI units, arrays read-only."""
