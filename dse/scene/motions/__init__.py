"""Velocity profiles: components of section `scene.motions`, one file each, with what scene.Motion asks."""
