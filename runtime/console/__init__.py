"""The terminal: styles, keys, progress, confirmation. No content of its own."""
