"""Runs in the formats of other programs: CSV, Excel workbooks, ASAM MDF 4 and Q-DAS. A module for
each format.

Large tables are read and written piece by piece. A value that is not known is empty or marked
invalid in each format, never 0.
"""
