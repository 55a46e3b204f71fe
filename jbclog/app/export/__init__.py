"""Exports runs to CSV, Excel workbooks, ASAM MDF 4 and Q-DAS; a module for each format.

Large tables are read and written piece by piece. An unknown value is empty or marked invalid in
each format, never 0.
"""
