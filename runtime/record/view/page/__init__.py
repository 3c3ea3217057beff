"""The page of `view`: HTML, CSS and JavaScript."""
