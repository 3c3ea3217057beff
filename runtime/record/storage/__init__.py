"""Recordings, read back.

trial       one recording: signals over the ticks, frames, events, what it says of itself
compare     two of them, signal by signal and tick by tick
diff        what differs, as a table and as a picture
replay      a recorded run once more, bit for bit, or through a changed diagram
"""
