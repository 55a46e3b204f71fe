"""A recorded run once more: reproduced from its serial captures without a port, or served as virtual stations.

Start with `recording.py`, then `reproduce.py` and `serving.py`.
"""
