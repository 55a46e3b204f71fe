"""Scan several ports side by side, and write a line file from what answers.

Start with `scan_ports.py`, then `line_file.py`.
"""
