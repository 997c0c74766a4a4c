"""A simulated tactile sensor: a soft tip with pins slides over textures, a camera sends events of the pins.

A scene file says what touches what (`load`, `scene`); trial k of a scene is the same events alone, in any
order and on any number of threads (`simulate`). Numbers of the physics are assumed where their doc says [A];
sources are in REFERENCES.md, 'Simulated touch'. To add a velocity profile, add one file to `motions/`; a
sensor or a texture is an entry of `sensors.yaml` or `textures.yaml`.
"""
