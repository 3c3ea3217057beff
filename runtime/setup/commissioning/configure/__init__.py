"""Changes of a drive or of a joint: set-up, zeroing, mounting."""
