"""Diagram files: loading, overrides, plants, the catalogue of blocks, drawings."""
