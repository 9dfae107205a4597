"""femnl: finite elements for the mechanics and nonlinearity of stressed membranes."""
