"""Files of a recording: their format, writing and reading, repair, and provenance.

format, messages, zstd_stream, mcap_file    the records of the ring, and the MCAP file that is written from them
contents, metadata, provenance              what a file contains, and how its run came about
scan, records, chunks, columns, reader      a file read in part, also one that is damaged or unfinished
parts                                       the files of one run as one recording
check, repair, correction                   what is damaged, and its repair
"""
