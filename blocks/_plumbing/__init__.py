"""Code shared by block files, not imported by diagrams."""
