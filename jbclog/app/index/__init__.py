"""An index of runs in the user's cache folder, for folders of thousands of runs. Start with
`run_index.py`.

It saves reading; it is never the truth. Every answer is the same without it.
"""
