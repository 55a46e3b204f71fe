"""Run folders and series of samples made without a station, and the recorded runs that the
repository keeps.
"""
