"""Typed plugins: what a scene is made of, one small file each.

Folder, file, registry name and template are called alike: `media/homogeneous.py` registers
`homogeneous` of kind `media` and is stated in POV-Ray's language by `templates/media/homogeneous.inc`.
`base.py` holds the base classes and the registry.
"""
