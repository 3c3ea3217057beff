"""Recordings: the recorder, files, analysis, export, and reports."""
