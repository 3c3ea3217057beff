"""Files of the page: HTML, CSS and JavaScript, without a build step. uPlot is vendored, with its licence."""
