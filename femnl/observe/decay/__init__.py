"""Decays: free motion after the drive is switched off."""
