"""What several block files share and no diagram imports."""
