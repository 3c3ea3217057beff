"""Terminal output and input: styles, status lines, keys and confirmation, without content."""
