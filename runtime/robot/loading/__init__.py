"""Diagram files: loading, overrides, plants, catalogue of blocks, drawings."""
