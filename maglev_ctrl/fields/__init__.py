"""Eddy-current fields of a conducting guideway: cross-sections, meshes and the fields solved on them."""
