"""Time: deadlines, overruns, stopwatches, histograms, real-time requests, signals that end a wait."""
